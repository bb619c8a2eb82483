// Corners of a picture, px of the target, which are dragged one by one or all together: `corners`.

import { between, made, rounded } from "./elements.js";

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
  let start = ""; // corners that it began with
  let width = 0, begun = 0; // of the picture that corners are px of: now, and at first

  function put(points, moving) {
    page.changed("corners", spelled(points), moving);
  }

  const spelled = (points) => points.map((one) => one.map(rounded).join(",")).join(" ");
  const sizes = (points) => [0, 1].map((axis) => {
    const all = points.map((one) => one[axis]);
    return [Math.min(...all), Math.max(...all)];
  });

  // An upright picture of a scale in the middle, at whole pixels
  function upright(scale) {
    const { width, height } = page.size(), [across, down] = page.about.extent;
    const x = Math.round((width - scale * across) / 2), y = Math.round((height - scale * down) / 2);
    const right = x + scale * across, bottom = y + scale * down;
    return [[x, y], [right, y], [right, bottom], [x, bottom]];
  }

  function most() {
    const { width, height } = page.size(), [across, down] = page.about.extent;
    return Math.min(width / across, height / down);
  }

  const isUpright = ([a, b, c, d]) => a[1] === b[1] && b[0] === c[0] && c[1] === d[1] && d[0] === a[0];

  // Scaled about its middle, which comes to the page's, where that is upright at whole pixels
  function scaled(points, factor) {
    const { width, height } = page.size(), [x, y] = sizes(points).map(([low, high]) => (low + high) / 2);
    return points.map((one) => [width / 2 + factor * (one[0] - x), height / 2 + factor * (one[1] - y)]);
  }

  // As large as the window has room for
  function fitted() {
    const points = known(), { width, height } = page.size();
    if (!points || isUpright(points)) { put(upright(most()), false); return; }
    const [x, y] = sizes(points);
    put(scaled(points, Math.min(width / (x[1] - x[0]), height / (y[1] - y[0]))), false);
  }

  // One texel for each pixel; of what is drawn askew, on average
  function exact() {
    const points = known(), [across, down] = page.about.extent;
    if (!points || isUpright(points)) { put(upright(1), false); return; }
    const area = points.reduce((sum, [x, y], n) => {
      const [u, v] = points[(n + 1) % 4];
      return sum + (x * v - u * y) / 2;
    }, 0);
    put(scaled(points, Math.sqrt((across * down) / Math.max(1, Math.abs(area)))), false);
  }

  function toggled() {
    const text = spelled(known() ?? []);
    exact();
    if (spelled(known() ?? []) === text) fitted();
  }

  function placed() {
    const box = canvas.getBoundingClientRect(), { width } = page.size(), points = known();
    handles.forEach((handle, n) => {
      handle.hidden = !points;
      if (!points) return;
      const [x, y] = points[n].map((one) => (one / width) * box.width);
      handle.style.left = `${between(9, x, box.width - 9)}px`;
      handle.style.top = `${between(9, y, box.height - 9)}px`;
    });
  }

  // Settings whose corners go with the picture's width
  function rescaled(settings, from) {
    const points = cornersOf(settings.corners), now = page.size().width;
    if (!points || !from || now === from) return { ...settings };
    return { ...settings, corners: spelled(points.map((one) => one.map((part) => (part * now) / from))) };
  }

  function resized() {
    const now = page.size().width;
    const wasStart = page.settings.corners === start;
    start = atStart().corners;
    if (wasStart) page.put("corners", start); // in the middle of the window, again
    else if (known() && width && now !== width) page.put("corners", rescaled(page.settings, width).corners);
    width = now;
  }

  // Where the picture begins: 1:1, or smaller where the window has no room for that
  function atStart() {
    const { settings } = page.about;
    return settings.corners === "" ? { ...settings, corners: spelled(upright(Math.min(1, most()))) } : rescaled(settings, begun);
  }

  function begin() {
    begun ||= page.about.width ?? page.size().width;
    width ||= begun;
    canvas.append(...handles);
  }

  function panned(dx, dy) {
    const per = pxPer(), points = known()?.map(([x, y]) => [x + dx * per, y + dy * per]);
    if (points) put(points, true);
  }

  function zoomed(factor, at) {
    const points = known(), { width, height } = page.size();
    const { x, y } = at ? page.placeOf({ clientX: at.x, clientY: at.y }) : { x: width / 2, y: height / 2 };
    if (points) put(points.map((one) => [x + factor * (one[0] - x), y + factor * (one[1] - y)]), true);
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
    help: [
      ["drag, arrows", "pan"],
      ["drag a corner", "move that corner alone"],
      ["wheel, two fingers, + and -", "zoom to the pointer"],
      ["0; 1, double-click", "fit it into the window; one texel for each pixel"],
      ["Home", "back to the first view"],
    ],
    hint: "arrows pan, plus and minus zoom",
    unfolds: true,
    frame: () => canvas.getBoundingClientRect(),
    begin, placed, resized, panned, zoomed, fitted, exact, toggled, rescaled, atStart,
    turned: panned,
    home: () => put(cornersOf(atStart().corners) ?? upright(1), false),
  };
}
