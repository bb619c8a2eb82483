// Orthogonal slices of a volume beside it, linked by one voxel. Each can be shown in the volume
// (`plane`) and cut it (`clip`).

import { planeOf, spelledPlane } from "./bounds.js";
import { between, hung, made, rounded } from "./elements.js";

const LETTERS = ["x", "y", "z"];
const PARALLEL = 0.9999; // cosine from which on a plane is a slice's

const inner = (a, b) => a.reduce((sum, one, n) => sum + one * b[n], 0);

export function slices(page) {
  const button = made("button", { id: "slices", "aria-pressed": "false", hidden: true, title: "Axial, coronal and sagittal slices beside the volume", onclick: () => turned(!isOn()) }, "Slices");
  let panes = [], voxel = null; // voxel: index along x, y and z, in which slices meet
  const isOn = () => button.getAttribute("aria-pressed") === "true";
  const count = () => page.about.box.voxels;
  const step = (axis) => page.about.box.lattice.map((row) => row[axis]);
  const normal = (axis) => step(axis).map((one) => one / Math.hypot(...step(axis)));
  const offset = (axis, index) => (index - (count()[axis] - 1) / 2) * Math.hypot(...step(axis));

  // Options of the volume's picture

  const isPlane = (text, axis) => String(text).startsWith(`${LETTERS[axis]}=`);
  const cutOf = (axis) => {
    const known = (page.settings.clip ?? []).map(planeOf);
    const n = known.findIndex((one) => one && Math.abs(inner(one.normal, normal(axis))) > PARALLEL);
    return n < 0 ? null : { n, sign: Math.sign(inner(known[n].normal, normal(axis))), offset: known[n].offset };
  };
  const planeText = (axis) => `${LETTERS[axis]}=${voxel[axis]}:window=${page.window().map(rounded).join("..")}`;

  function replacedIn(key, n, text) {
    const given = [...(page.settings[key] ?? [])];
    given.splice(n < 0 ? given.length : n, n < 0 ? 0 : 1, ...(text ? [text] : []));
    return given.length ? given : undefined;
  }

  function shownIn(axis, on) {
    const n = (page.settings.plane ?? []).findIndex((one) => isPlane(one, axis));
    page.changed("plane", replacedIn("plane", n, on ? planeText(axis) : ""));
  }

  // The half nearer to the eye goes away, and goes on doing so.
  function cutBy(axis, on) {
    const known = cutOf(axis), sign = known?.sign ?? (page.toward(normal(axis)) < 0 ? -1 : 1);
    page.changed("clip", replacedIn("clip", known?.n ?? -1, on ? cutText(axis, sign) : ""));
  }

  const cutText = (axis, sign) => spelledPlane({ normal: normal(axis).map((one) => sign * one), offset: sign * offset(axis, voxel[axis]) });

  // Options after slices or the window have moved; whether any differs.
  function written() {
    const before = JSON.stringify([page.settings.plane, page.settings.clip]);
    for (const { across: axis } of page.about.slices ?? []) {
      const n = (page.settings.plane ?? []).findIndex((one) => isPlane(one, axis)), cut = cutOf(axis);
      if (n >= 0) page.put("plane", replacedIn("plane", n, planeText(axis)));
      if (cut) page.put("clip", replacedIn("clip", cut.n, cutText(axis, cut.sign)));
    }
    return before !== JSON.stringify([page.settings.plane, page.settings.clip]);
  }

  // Slices as options have them, after those were replaced
  function read() {
    if (!voxel) return;
    for (const { across: axis } of page.about.slices) {
      const text = (page.settings.plane ?? []).find((one) => isPlane(one, axis)), cut = cutOf(axis);
      const at = text ? Number.parseFloat(text.slice(2)) : cut && (cut.sign * cut.offset) / Math.hypot(...step(axis)) + (count()[axis] - 1) / 2;
      if (Number.isFinite(at ?? NaN)) voxel[axis] = between(0, Math.round(at), count()[axis] - 1);
    }
    drawn();
  }

  // Slices move to a voxel.
  function moved(to, moving) {
    voxel = to.map((one, axis) => between(0, Math.round(one), count()[axis] - 1));
    drawn();
    if (written()) page.wish(moving); else page.leafed(moving);
  }

  // What undo comes back to; null: the middle, where slices begin
  const begun = () => count().map((one) => Math.floor(one / 2));
  const at = () => (voxel && voxel.join() !== begun().join() ? [...voxel] : null);
  function put(to) {
    if (voxel || to) voxel = to ? [...to] : begun();
  }

  // Panes

  function pane(plane) {
    const { name, across, right, down } = plane, most = count()[across] - 1;
    const image = made("img", { alt: `${name} slice`, draggable: false });
    const lines = document.createElementNS("http://www.w3.org/2000/svg", "svg"), path = document.createElementNS("http://www.w3.org/2000/svg", "path");
    lines.classList.add("lines");
    lines.append(path);
    const caption = made("div", { class: "caption top", id: `slice-${name}-caption` });
    const view = made("div", { class: "slice-view", id: `slice-${name}`, tabIndex: 0, role: "application", "aria-label": `${name} slice: click to move the others, scroll through slices with the wheel or arrows` }, image, lines, caption);
    const range = made("input", { type: "range", id: `slice-${name}-range`, min: "0", max: String(most), step: "1", "aria-label": `${name} slice` });
    const number = made("input", { type: "number", id: `slice-${name}-number`, min: "0", max: String(most), step: "1", "aria-label": `${name} slice, as a number` });
    const shows = made("input", { type: "checkbox", id: `slice-${name}-show` }), cuts = made("input", { type: "checkbox", id: `slice-${name}-cut` });
    const bar = made("div", { class: "slice-bar" }, range, number,
      made("label", { title: "Show this slice in the volume" }, shows, "show"), made("label", { title: "Clip the volume at this slice" }, cuts, "cut"));
    const held = { plane, view, image, path, caption, range, number, shows, cuts, waiting: false, again: false };
    held.element = made("figure", { class: "pane slice" }, view, bar);
    const leafed = (to, moving) => moved(voxel.map((one, axis) => (axis === across ? to : one)), moving);
    range.addEventListener("input", () => leafed(range.valueAsNumber, true));
    range.addEventListener("change", () => leafed(range.valueAsNumber, false));
    number.addEventListener("change", () => { if (number.value !== "") leafed(number.valueAsNumber, false); });
    shows.addEventListener("change", () => shownIn(across, shows.checked));
    cuts.addEventListener("change", () => cutBy(across, cuts.checked));
    let isDown = false, last = null; // last: where the pointer was, while the window is dragged
    const pointed = (event, moving) => {
      const place = placeIn(held, event);
      const to = voxel.map((one, axis) => (axis === right ? place[0] : axis === down ? place[1] : one));
      if (page.measuring()) { if (!moving) page.marked(positionOf(to)); } else moved(to, moving);
    };
    view.addEventListener("pointerdown", (event) => { view.setPointerCapture(event.pointerId); if (page.contrast.takes(event)) { last = [event.clientX, event.clientY]; return; } isDown = true; if (!page.measuring()) pointed(event, true); });
    view.addEventListener("pointermove", (event) => {
      if (last) { page.contrast.dragged(event.clientX - last[0], event.clientY - last[1]); last = [event.clientX, event.clientY]; }
      if (isDown) pointed(event, true);
    });
    view.addEventListener("pointerup", (event) => { if (isDown) pointed(event, false); isDown = false; });
    view.addEventListener("lostpointercapture", () => { isDown = false; last = null; });
    view.addEventListener("wheel", (event) => { event.preventDefault(); leafed(voxel[across] + Math.sign(event.deltaY), true); }, { passive: false });
    view.addEventListener("keydown", (event) => {
      const by = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: 10, PageDown: -10 }[event.key];
      if (!by) return;
      event.preventDefault();
      leafed(voxel[across] + by, true);
    });
    return held;
  }

  // Where a slice is in its pane, px, and its sides in scene units
  function frameOf({ plane, view }) {
    const { clientWidth: width, clientHeight: height } = view;
    const sides = [plane.right, plane.down].map((axis) => count()[axis] * page.about.spacing[axis]);
    const scale = Math.min(width / sides[0], height / sides[1]);
    return { width: scale * sides[0], height: scale * sides[1], left: (width - scale * sides[0]) / 2, top: (height - scale * sides[1]) / 2 };
  }

  // Indices along the two axes of a slice, to the right and down, under the pointer
  function placeIn(held, event) {
    const box = held.view.getBoundingClientRect(), frame = frameOf(held), { plane } = held;
    const share = [(event.clientX - box.left - frame.left) / frame.width, (event.clientY - box.top - frame.top) / frame.height];
    return [[plane.right, plane.right_sign], [plane.down, plane.down_sign]].map(([axis, sign], n) => {
      const at = sign > 0 ? share[n] : 1 - share[n];
      return between(0, Math.floor(at * count()[axis]), count()[axis] - 1);
    });
  }

  // px in a pane of indices along its two axes
  function pixelIn(held, index) {
    const frame = frameOf(held), { plane } = held;
    const [x, y] = [[plane.right, plane.right_sign], [plane.down, plane.down_sign]].map(([axis, sign]) => {
      const at = (index[axis] + 0.5) / count()[axis];
      return sign > 0 ? at : 1 - at;
    });
    return [frame.left + x * frame.width, frame.top + y * frame.height];
  }

  const positionOf = (index) => [0, 1, 2].map((n) => [0, 1, 2].reduce((sum, axis) => sum + step(axis)[n] * (index[axis] - (count()[axis] - 1) / 2), 0));
  const indexOf = (place) => [0, 1, 2].map((axis) => inner(place, step(axis)) / inner(step(axis), step(axis)) + (count()[axis] - 1) / 2);

  function asked(held) {
    if (held.waiting) { held.again = true; return; }
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const [width, height] = [held.view.clientWidth, held.view.clientHeight].map((one) => between(8, Math.round(one * ratio), 2048));
    held.waiting = true;
    page.panes.setAttribute("aria-busy", "true");
    page.say("slice", { plane: held.plane.name, voxel, window: page.places(), width, height });
  }

  // Lines of the other slices, and those between places that were measured
  function drawnLines(held) {
    const [x, y] = pixelIn(held, voxel), { left, top, width, height } = frameOf(held);
    const cross = `M${x} ${top}V${y - 6}M${x} ${y + 6}V${top + height}M${left} ${y}H${x - 6}M${x + 6} ${y}H${left + width}`;
    const places = page.marks().map(indexOf), { across } = held.plane;
    const near = places.length > 1 && places.every((one) => Math.abs(one[across] - voxel[across]) <= 0.5);
    held.path.setAttribute("d", cross + (near ? `M${places.map((one) => pixelIn(held, one).join(" ")).join("L")}` : ""));
  }

  function drawn() {
    if (!isOn() || !voxel) return;
    for (const held of panes) {
      const { across } = held.plane;
      held.range.value = held.number.value = held.number.dataset.shown = String(voxel[across]);
      held.shows.checked = (page.settings.plane ?? []).some((one) => isPlane(one, across));
      held.cuts.checked = Boolean(cutOf(across));
      drawnLines(held);
      asked(held);
    }
  }

  function turned(on) {
    button.setAttribute("aria-pressed", String(on));
    voxel ??= begun();
    if (on && !panes.length) panes = page.about.slices.map(pane);
    page.panes.classList.toggle("sliced", on);
    if (on) page.canvas.after(...panes.map((held) => held.element));
    else for (const held of panes) held.element.remove();
    read();
    if (on) page.amended(); // slices that options have are where they are
  }

  function framed(head, bytes) {
    const held = panes.find((one) => one.plane.name === head.plane);
    if (!held) return;
    hung(held.image, bytes, head.type);
    held.image.dataset.number = head.number;
    held.caption.textContent = `${head.plane} · ${LETTERS[held.plane.across]} ${voxel[held.plane.across]} · value ${head.value}`;
    held.waiting = false;
    if (held.again) { held.again = false; asked(held); }
    if (!panes.some((one) => one.waiting)) page.panes.setAttribute("aria-busy", "false");
  }

  function begin() {
    button.hidden = !page.about.slices;
    for (const held of panes) held.waiting = held.again = false;
  }

  // The window has moved, too.
  function refreshed() {
    if (!isOn()) return;
    written();
    drawn();
  }

  function reset() {
    voxel = null;
    if (isOn()) turned(false);
  }

  new ResizeObserver(() => drawn()).observe(page.panes);
  return { button, begin, framed, at, put, read, refreshed, reset, lines: () => { if (isOn()) panes.forEach(drawnLines); } };
}
