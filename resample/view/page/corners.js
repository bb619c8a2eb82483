// Corners of a picture, px of the target, which are dragged one by one or all together: `corners`.

import { made, rounded } from "./elements.js";

function cornersOf(text) {
  const points = String(text ?? "").trim().split(/\s+/).map((one) => one.split(",").map(Number));
  const whole = points.length === 4 && points.every((one) => one.length === 2 && one.every(Number.isFinite));
  return whole ? points : null;
}

export function corners(page) {
  const { canvas } = page;
  const handles = [0, 1, 2, 3].map((n) => made("button", {
    class: "handle", id: `corner-${n}`,
    "aria-label": `Corner ${n + 1}: drag it, or move it with the arrows`,
  }));
  const known = () => cornersOf(page.settings.corners);
  const pxPer = () => page.size().width / canvas.getBoundingClientRect().width;
  let width = 0; // of the picture that corners are px of

  function put(points, moving) {
    page.changed("corners", points.map((one) => one.map(rounded).join(",")).join(" "), moving);
  }

  function fitted() {
    const { width, height } = page.size(), [across, down] = page.about.extent;
    const scale = 0.8 * Math.min(width / across, height / down);
    const x = (width - scale * across) / 2, y = (height - scale * down) / 2;
    const right = x + scale * across, bottom = y + scale * down;
    return [[x, y], [right, y], [right, bottom], [x, bottom]];
  }

  function placed() {
    const box = canvas.getBoundingClientRect(), { width } = page.size(), points = known();
    handles.forEach((handle, n) => {
      handle.hidden = !points;
      if (!points) return;
      handle.style.left = `${(points[n][0] / width) * box.width}px`;
      handle.style.top = `${(points[n][1] / width) * box.width}px`;
    });
  }

  // Corners go with the picture's width.
  function resized() {
    const now = page.size().width, points = known();
    if (points && width && now !== width) {
      put(points.map((one) => one.map((part) => (part * now) / width)), true);
    }
    width = now;
  }

  function begin() {
    width = page.about.width ?? width;
    canvas.append(...handles);
    if (page.about.settings.corners === "") {
      page.about.settings.corners = fitted().map((one) => one.map(rounded).join(",")).join(" ");
    }
  }

  function panned(dx, dy) {
    const per = pxPer(), points = known()?.map(([x, y]) => [x + dx * per, y + dy * per]);
    if (points) put(points, true);
  }

  function zoomed(factor) {
    const points = known(), { width, height } = page.size();
    const around = ([x, y]) => [width / 2 + factor * (x - width / 2), height / 2 + factor * (y - height / 2)];
    if (points) put(points.map(around), true);
  }

  handles.forEach((handle, n) => {
    const move = (dx, dy) => {
      const points = known(), per = pxPer();
      if (!points) return;
      points[n] = [points[n][0] + dx * per, points[n][1] + dy * per];
      put(points, true);
    };
    let last = null;
    handle.addEventListener("pointerdown", (event) => {
      event.stopPropagation();
      handle.setPointerCapture(event.pointerId);
      last = [event.clientX, event.clientY];
    });
    handle.addEventListener("pointermove", (event) => {
      if (!last) return;
      move(event.clientX - last[0], event.clientY - last[1]);
      last = [event.clientX, event.clientY];
    });
    handle.addEventListener("pointerup", (event) => { event.stopPropagation(); last = null; });
    handle.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-2, 0], ArrowRight: [2, 0], ArrowUp: [0, -2], ArrowDown: [0, 2] }[event.key];
      if (!by) return;
      event.preventDefault();
      event.stopPropagation();
      move(...by);
    });
  });

  return {
    hint: "arrows move it, plus and minus make it larger and smaller",
    unfolds: true,
    frame: () => canvas.getBoundingClientRect(),
    begin, placed, resized, panned, zoomed,
    turned: panned,
    home: () => put(fitted(), false),
  };
}
