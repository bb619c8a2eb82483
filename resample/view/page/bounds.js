// Handles by which a volume is cut: six on the sides of a box of voxels (`crop`), and two on each
// plane (`clip`), one that moves it along its normal and one that turns it. Scene units are
// around the volume's middle; a frame tells how they come to its pixels (`view`).

import { between, made, rounded } from "./elements.js";

const AXES = ["x", "y", "z"];
const FLAT = 0.15; // of its length on the screen, below which an axis points at the eye
const TURN = (5 * Math.PI) / 180; // by a key
const SHARE = 0.35; // of the volume's diagonal: from a plane to the handle that turns it
const STEPS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 };

const dot = (a, b) => a.reduce((sum, one, n) => sum + one * b[n], 0);
const plus = (a, b, times = 1) => a.map((one, n) => one + times * b[n]);
const unit = (a) => a.map((one) => one / Math.hypot(...a));
const across = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];

// First voxel and the one after the last along each axis; null: it is no crop.
function rangesOf(text, voxels) {
  const parts = String(text ?? ":,:,:").split(",");
  if (parts.length !== 3) return null;
  const ranges = parts.map((part, axis) => {
    const words = part.trim().split(":"), size = voxels[axis];
    const at = (word, usual) => {
      if (word.trim() === "") return usual;
      return between(0, Number(word) < 0 ? size + Number(word) : Number(word), size);
    };
    if (words.length === 1 && words[0] !== "") return [at(words[0], NaN), at(words[0], NaN) + 1];
    return words.length === 2 ? [at(words[0], 0), at(words[1], size)] : [NaN, NaN];
  });
  return ranges.flat().every(Number.isInteger) ? ranges : null;
}

function spelledRanges(ranges, voxels) {
  const parts = ranges.map(([low, high], axis) => `${low || ""}:${high === voxels[axis] ? "" : high}`);
  return parts.every((one) => one === ":") ? undefined : parts.join(",");
}

// Normal of length 1, and how far from the middle along it; null: it is no plane.
export function planeOf(text) {
  const numbers = String(text).split(/[,/]/).map(Number);
  if (![3, 4].includes(numbers.length) || !numbers.every(Number.isFinite)) return null;
  const normal = numbers.slice(0, 3);
  return normal.some(Boolean) ? { normal: unit(normal), offset: numbers[3] ?? 0 } : null;
}

export function spelledPlane({ normal, offset }) {
  const parts = normal.map((one) => String(Number(one.toFixed(4)) || 0));
  return [...parts, ...(offset ? [rounded(offset)] : [])].join(",");
}

// A button that is dragged, or moved by keys. `moved` is told how far it was dragged in all.
function grip(id, label, { began, moved, key }) {
  const element = made("button", { class: "handle cut", id, role: "slider", "aria-label": label, title: label });
  let from = null;
  element.addEventListener("pointerdown", (event) => {
    event.stopPropagation();
    element.setPointerCapture(event.pointerId);
    from = [event.clientX, event.clientY];
    began();
  });
  element.addEventListener("pointermove", (event) => {
    if (from) moved(event.clientX - from[0], event.clientY - from[1]);
  });
  element.addEventListener("pointerup", (event) => { event.stopPropagation(); from = null; });
  element.addEventListener("lostpointercapture", () => { from = null; });
  element.addEventListener("keydown", (event) => {
    if (!key(event)) return;
    event.preventDefault();
    event.stopPropagation();
  });
  return element;
}

export function bounds(page) {
  const { canvas } = page;
  const lines = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  const button = (id, title, text, onclick) => made("button", { id, title, hidden: true, onclick }, text);
  const crop = button("crop", "Crop the volume to a box with handles on its sides", "Crop", () => turned(crop));
  const clip = button("clip", "Clip the volume by planes; each has a handle that moves it and one that tilts it", "Clip", () => turned(clip));
  const add = button("clip-add", "Add a plane", "+", () => added());
  const remove = button("clip-remove", "Remove a plane", "−", () => removed());
  let view = null, chosen = 0;
  let sides = [], grips = []; // handles of the box, and pairs of those of planes
  lines.classList.add("lines");
  lines.append(path);

  const box = () => page.about.box;
  const isOn = (one) => one.getAttribute("aria-pressed") === "true";
  const ranges = () => rangesOf(page.settings.crop, box().voxels);
  const planes = () => (page.settings.clip ?? []).map(planeOf);
  const column = (axis) => box().lattice.map((row) => row[axis]); // step to the next voxel
  const place = (index) => AXES.reduce((sum, _, n) => plus(sum, column(n), index[n] - (box().voxels[n] - 1) / 2), [0, 0, 0]);
  const diagonal = () => Math.hypot(...AXES.map((_, n) => box().voxels[n] * Math.hypot(...column(n))));

  // Where a point is in the picture, px of the page, and px of a scene unit there; null: behind the eye
  function projected(point) {
    if (!view) return null; // of a lens or a map, which no lines follow
    const seen = view.rotation.map((row, n) => dot(row, point) + view.translation[n]);
    const depth = view.perspective ? seen[2] : 1, per = canvas.getBoundingClientRect().width / view.size[0];
    if (depth <= 0) return null;
    const at = [0, 1].map((n) => per * ((view.focal[n] * seen[n]) / depth + view.principal[n]));
    return { at, scale: (per * view.focal[0]) / depth };
  }

  // How many steps along an axis bring a point nearest to where the pointer was dragged
  function steps(point, axis, dx, dy) {
    const start = projected(point), long = Math.hypot(...axis);
    let count = 0;
    for (let n = 0; start && n < 3; n += 1) {
      const here = projected(plus(point, axis, count)), next = projected(plus(point, axis, count + 1e-3));
      if (!here || !next) return count;
      const way = here.at.map((one, k) => (next.at[k] - one) / 1e-3);
      if (Math.hypot(...way) < FLAT * long * here.scale) return -dy / (long * here.scale);
      const left = [start.at[0] + dx - here.at[0], start.at[1] + dy - here.at[1]];
      count += dot(left, way) / dot(way, way);
    }
    return count;
  }

  function turned(one) {
    const on = !isOn(one);
    one.setAttribute("aria-pressed", String(on));
    if (one === clip) {
      add.hidden = remove.hidden = !on;
      if (on && !planes().length) { added(); return; }
    }
    placed();
  }

  // The box

  const middleOf = (of, axis, side) => place(of.map(([low, high], n) => (n === axis ? [low, high][side] - 0.5 : (low + high - 1) / 2)));

  function cropped(axis, side, to) {
    const now = ranges(), size = box().voxels[axis];
    if (!now) return;
    const [low, high] = now[axis], whole = Math.round(to);
    now[axis] = side ? [low, between(low + 1, whole, size)] : [between(0, whole, high - 1), high];
    page.changed("crop", spelledRanges(now, box().voxels), true);
  }

  function side(axis, end) {
    let from = null;
    return grip(`crop-${AXES[axis]}-${end ? "high" : "low"}`, `Crop ${AXES[axis]} ${end ? "up to" : "from"} here: drag it, or use arrows`, {
      began: () => { from = ranges(); },
      moved: (dx, dy) => {
        if (from) cropped(axis, end, from[axis][end] + steps(middleOf(from, axis, end), column(axis), dx, dy));
      },
      key: (event) => {
        const by = STEPS[event.key] * (event.shiftKey ? 10 : 1), now = ranges();
        if (by && now) cropped(axis, end, now[axis][end] + by);
        return Boolean(by);
      },
    });
  }

  // Planes

  function write(given) {
    page.changed("clip", given.length ? given : undefined, true);
  }

  function replacedPlane(n, plane) {
    write(page.settings.clip.map((text, k) => (k === n ? spelledPlane(plane) : text)));
  }

  // A plane that cuts the near half away, along the axis that points at the eye most
  function added() {
    if (!view) return;
    const known = planes().filter(Boolean), way = view.rotation[2];
    const taken = (axis) => known.some(({ normal }) => Math.abs(normal[axis]) > 0.9);
    const order = [0, 1, 2].sort((a, b) => Math.abs(way[b]) - Math.abs(way[a]));
    const axis = order.find((one) => !taken(one)) ?? order[0];
    const normal = [0, 0, 0];
    normal[axis] = way[axis] < 0 ? -1 : 1;
    chosen = known.length;
    write([...(page.settings.clip ?? []), spelledPlane({ normal, offset: 0 })]);
  }

  function removed() {
    const given = page.settings.clip ?? [], n = between(0, chosen, given.length - 1);
    write(given.filter((_, k) => k !== n));
  }

  // Normal after its tip was moved over the screen by angles, to the right and down
  function tilted(normal, right, down) {
    const [toRight, toDown] = view.rotation;
    return unit(plus(plus(normal, toRight, Math.tan(right)), toDown, Math.tan(down)));
  }

  function pair(n) {
    let from = null;
    const began = () => { chosen = n; from = planes()[n]; };
    const isDelete = (event) => {
      if (event.key !== "Delete") return false;
      chosen = n;
      removed();
      return true;
    };
    const mover = grip(`clip-${n}-move`, `Plane ${n + 1}: drag it along its normal, or use arrows`, {
      began,
      moved: (dx, dy) => {
        const foot = from.normal.map((one) => one * from.offset);
        replacedPlane(n, { ...from, offset: from.offset + steps(foot, from.normal, dx, dy) });
      },
      key: (event) => {
        const by = STEPS[event.key] * (event.shiftKey ? 0.1 : 0.01) * diagonal(), now = planes()[n];
        if (by && now) replacedPlane(n, { ...now, offset: now.offset + by });
        return Boolean(by) || isDelete(event);
      },
    });
    const turner = grip(`clip-${n}-turn`, `Plane ${n + 1}: turn it by dragging, or use arrows`, {
      began,
      moved: (dx, dy) => {
        const tip = projected(from.normal.map((one) => one * (from.offset + SHARE * diagonal())));
        if (!tip) return;
        const per = SHARE * diagonal() * tip.scale;
        replacedPlane(n, { ...from, normal: tilted(from.normal, Math.atan(dx / per), Math.atan(dy / per)) });
      },
      key: (event) => {
        const by = { ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, -TURN], ArrowDown: [0, TURN] }[event.key];
        const now = planes()[n];
        if (by && now) replacedPlane(n, { ...now, normal: tilted(now.normal, ...by) });
        return Boolean(by) || isDelete(event);
      },
    });
    return [mover, turner];
  }

  // Drawn over the picture

  function put(element, point, value) {
    const found = point && projected(point);
    element.hidden = !found;
    if (!found) return;
    const { width, height } = canvas.getBoundingClientRect();
    element.style.left = `${between(9, found.at[0], width - 9)}px`;
    element.style.top = `${between(9, found.at[1], height - 9)}px`;
    element.setAttribute("aria-valuetext", value);
    element.setAttribute("aria-valuenow", String(Number.parseFloat(value)));
  }

  function stroke(...points) {
    const found = points.map((point) => projected(point)?.at);
    return found.length > 1 && found.every(Boolean) ? `M${found.map((at) => at.map((one) => one.toFixed(1)).join(" ")).join("L")}` : "";
  }

  function drawnBox(now) {
    sides.forEach((element, n) => {
      const axis = n >> 1, end = n & 1;
      put(element, now && middleOf(now, axis, end), String(now?.[axis][end]));
    });
    if (!now) return "";
    const corner = (n) => place(now.map((range, axis) => range[(n >> axis) & 1] - 0.5));
    const edges = [0, 1, 2].flatMap((axis) => [...Array(8).keys()].filter((n) => !((n >> axis) & 1)).map((n) => [n, n | (1 << axis)]));
    return edges.map(([a, b]) => stroke(corner(a), corner(b))).join("");
  }

  function drawnPlanes(known) {
    while (grips.length > known.length) grips.pop().forEach((one) => one.remove());
    while (grips.length < known.length) { grips.push(pair(grips.length)); canvas.append(...grips.at(-1)); }
    return known.map((plane, n) => {
      const [mover, turner] = grips[n];
      if (!plane) { mover.hidden = turner.hidden = true; return ""; }
      const { normal, offset } = plane, long = SHARE * diagonal();
      const foot = normal.map((one) => one * offset), tip = plus(foot, normal, long);
      put(mover, foot, rounded(offset));
      put(turner, tip, spelledPlane({ normal, offset: 0 }));
      const flat = [0, 1, 2].sort((a, b) => Math.abs(normal[a]) - Math.abs(normal[b]))[0];
      const one = unit(across(normal, [0, 1, 2].map((axis) => Number(axis === flat)))), other = across(normal, one);
      const corners = [[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]].map(([a, b]) => plus(plus(foot, one, a * long), other, b * long));
      return stroke(...corners) + stroke(foot, tip);
    }).join("");
  }

  function placed() {
    if (!box() || !view) return;
    const parts = drawnBox(isOn(crop) ? ranges() : null) + drawnPlanes(isOn(clip) ? planes() : []);
    path.setAttribute("d", parts);
  }

  function begin() {
    crop.hidden = clip.hidden = !box();
    if (!box() || sides.length) return;
    sides = AXES.flatMap((_, axis) => [0, 1].map((end) => side(axis, end)));
    for (const one of sides) one.hidden = true;
    canvas.append(lines, ...sides);
  }

  function framed(given) {
    view = given ?? null;
    placed();
  }

  // Without handles
  function reset() {
    for (const one of [crop, clip]) if (isOn(one)) turned(one);
  }

  return {
    buttons: [crop, clip, add, remove], begin, placed, framed, reset,
    projected: (point) => (view ? projected(point) : null),
    toward: (way) => (view ? dot(view.rotation[2], way) : 1), // above 0: away from the eye
  };
}
