// The histogram, over which the window and the points of the look are dragged: `window` and
// `transfer`.

import { drawnTicks, short, ticks } from "./axis.js";
import { between, made, rounded } from "./elements.js";

const NEAR = 12; // px within which a point of a curve is taken

const BELOW_CHART = 19; // px under the histogram, for numbers

const NEAR_ZERO = 1 / (1 - 1 / 10); // decades of a symmetric logarithm that are linear

// Places of values on the histogram's scale, and the values of places; all that is dragged are places.
export function scaleOf({ scale, linear } = {}) {
  if (scale === "log") return { to: Math.log10, from: (place) => 10 ** place };
  if (scale !== "symlog") return { to: (value) => value, from: (place) => place };
  return {
    to: (value) => Math.abs(value) <= linear
      ? (value / linear) * NEAR_ZERO : Math.sign(value) * (NEAR_ZERO + Math.log10(Math.abs(value) / linear)),
    from: (place) => linear * (Math.abs(place) <= NEAR_ZERO
      ? place / NEAR_ZERO : Math.sign(place) * 10 ** (Math.abs(place) - NEAR_ZERO)),
  };
}

// Points of a look: value, color and opacity each; null: it is not given by points.
function pointsOf(transfer) {
  const text = String(transfer ?? ""); // 40,red,0 90,white,0.5 or 40/red/0,90/white/0.5
  const parts = text.split(text.includes("/") ? "," : " ").map((part) => part.split(/[,/]/));
  if (parts.some((part) => part.length !== 3)) return null;
  const points = parts.map(([value, color, opacity]) => [Number(value), color, Number(opacity)]);
  return points.some(([value, , opacity]) => Number.isNaN(value + opacity)) ? null : points;
}

function spelledPoints(points) {
  return points.map(([value, color, opacity]) => `${rounded(value)},${color},${rounded(opacity)}`).join(" ");
}

export function histogram(page) {
  const element = made("canvas", { class: "histogram", id: "histogram", tabIndex: 0,
    "aria-label": "Histogram: drag to choose a window, arrows move it; brackets choose a point of the look, "
      + "arrows then move it, Delete removes it, Enter adds one" });
  const color = made("input", { type: "color", id: "point-color", "aria-label": "Color of the point" });
  const value = made("input", { type: "number", step: "any", id: "point-value", "aria-label": "Value of the point" });
  const opacity = made("input", { type: "number", step: "any", min: 0, max: 1, id: "point-opacity", "aria-label": "Opacity of the point" });
  const looks = made("select", { id: "looks", "aria-label": "Transfer functions" });
  const tools = made("div", { class: "tools" }, looks, color, value, opacity,
    made("button", { id: "point-add", title: "Add a point", "aria-label": "Add a point", onclick: () => added() }, "+"),
    made("button", { id: "point-remove", title: "Remove the point", "aria-label": "Remove the point", onclick: () => removed() }, "−"));
  const under = made("div", { class: "under", id: "under-pointer", role: "status" });
  let from = null, known = null, asked = "", chosen = -1, held = null;
  const span = () => page.about.histogram.high - page.about.histogram.low || 1;
  const shareOf = (event) => {
    const box = element.getBoundingClientRect();
    return between(0, (event.clientX - box.left) / box.width, 1);
  };
  const valueAt = (event) => page.about.histogram.low + shareOf(event) * span();
  // Opacities are drawn by their square root, as small ones matter most.
  const opacityAt = (event) => {
    const box = element.getBoundingClientRect();
    return between(0, 1 - (event.clientY - box.top) / (box.height - BELOW_CHART), 1) ** 2;
  };
  const scale = () => scaleOf(page.about?.histogram);
  const points = () => (pointsOf(page.settings.transfer) ?? known?.points ?? []).map(
    ([one, ...rest]) => [scale().to(one), ...rest]);
  const isOwn = () => pointsOf(page.settings.transfer) !== null;
  const windowEnds = () => {
    const text = String(page.settings.window ?? ""), named = text.includes("..");
    const parts = text.split(named ? ".." : /[,/]/).map(Number);
    if (parts.length !== 2 || parts.some(Number.isNaN)) return null;
    return (named ? parts : [parts[0] - parts[1] / 2, parts[0] + parts[1] / 2]).map(scale().to);
  };
  const put = (a, b, moving) => {
    const low = Math.min(a, b), width = Math.abs(b - a);
    if (width <= span() / 500) return;
    const { from: value } = scale();
    page.changed("window", page.about.histogram.scale ? `${rounded(value(low))}..${rounded(value(low + width))}`
      : `${rounded(low + width / 2)},${rounded(width)}`, moving);
  };
  // The look becomes its points, in data units, which no window spreads.
  const write = (given, moving) => {
    if (!isOwn()) {
      page.changed("window", undefined, true);
      if (known?.unit && page.settings["opacity-unit"] === undefined) page.changed("opacity-unit", known.unit, true);
    }
    page.changed("transfer", spelledPoints(given.map(([one, ...rest]) => [scale().from(one), ...rest])), moving);
  };
  // Values where the look begins and ends
  const isWindowed = () => known?.windowed !== false && (page.settings.window !== undefined || (page.settings.transfer ?? "auto") !== "auto");
  const ends = () => {
    const given = points(), range = windowEnds();
    if (!isOwn() && range) return range.map(scale().from);
    if ((isOwn() || !isWindowed()) && given.length > 1) return [given[0][0], given.at(-1)[0]].map(scale().from);
    return [page.about.histogram.low, page.about.histogram.high].map(scale().from);
  };
  const spread = (low, high, moving) => {
    const given = points(), [a, b] = [low, high].map(scale().to);
    if ((!isOwn() && isWindowed()) || given.length < 2) { put(a, b, moving); return; }
    const first = given[0][0], wide = given.at(-1)[0] - first || 1;
    write(given.map(([one, ...rest]) => [a + ((one - first) / wide) * (b - a), ...rest]), moving);
  };
  // A drag in the picture: right for a wider window, up for a higher level
  const windowed = (dx, dy) => {
    const [low, high] = ends().map(scale().to), wide = Math.max((high - low) * Math.exp(dx / 200), span() / 250);
    const middle = (low + high) / 2 - (dy / 200) * (high - low);
    spread(...[middle - wide / 2, middle + wide / 2].map(scale().from), true);
  };
  const moved = (n, to, height, moving) => {
    const given = points();
    if (!given[n]) return;
    const low = given[n - 1]?.[0] ?? -Infinity, high = given[n + 1]?.[0] ?? Infinity;
    given[n] = [between(low, to, high), given[n][1], between(0, height, 1)];
    write(given, moving);
  };
  const added = (at, height) => {
    const given = points();
    let n = given.findIndex(([one]) => at !== undefined && one > at);
    if (at === undefined) n = between(1, chosen + 1, Math.max(1, given.length - 1));
    if (n < 0) n = given.length;
    const near = given[n - 1] ?? given[n], next = given[n] ?? near;
    if (!near) return;
    given.splice(n, 0, [at ?? (near[0] + next[0]) / 2, near[1], height ?? (near[2] + next[2]) / 2]);
    chosen = n;
    write(given, false);
  };
  const removed = () => {
    const given = points();
    if (given.length < 2 || !given[chosen]) return;
    given.splice(chosen, 1);
    chosen = Math.min(chosen, given.length - 1);
    write(given, false);
  };
  const nearest = (event) => {
    const box = element.getBoundingClientRect();
    const far = points().map(([one, , high]) => Math.hypot(
      event.clientX - box.left - between(0, (one - page.about.histogram.low) / span(), 1) * box.width,
      event.clientY - box.top - (1 - Math.sqrt(high)) * (box.height - BELOW_CHART)));
    const n = far.indexOf(Math.min(...far));
    return far[n] <= NEAR ? n : -1;
  };
  const fill = () => {
    const point = points()[chosen];
    for (const input of [color, value, opacity]) input.disabled = !point;
    if (!point) return;
    if (/^#[0-9a-f]{6}$/i.test(point[1])) color.value = point[1];
    if (document.activeElement !== value) value.value = rounded(scale().from(point[0]));
    if (document.activeElement !== opacity) opacity.value = rounded(point[2]);
  };
  const draw = () => {
    if (!page.about?.histogram) return;
    const ratio = window.devicePixelRatio || 1, box = element.getBoundingClientRect();
    element.width = Math.max(1, box.width * ratio);
    element.height = Math.max(1, box.height * ratio);
    const pen = element.getContext("2d"), style = getComputedStyle(page.el);
    const tall = element.height - BELOW_CHART * ratio, to = (place) => between(0, (place - page.about.histogram.low) / span(), 1) * element.width;
    drawnBars(pen, tall, style);
    drawnNumbers(pen, tall, ratio, to, style);
    drawnCurve(pen, tall, ratio, to, style);
    fill();
  };
  const drawnBars = (pen, tall, style) => {
    const { counts, low } = page.about.histogram, range = windowEnds();
    const most = Math.log1p(Math.max(...counts, 1)), step = element.width / counts.length;
    counts.forEach((count, n) => {
      const at = low + ((n + 0.5) / counts.length) * span();
      const inside = !range || (at >= range[0] && at <= range[1]);
      pen.fillStyle = style.getPropertyValue(inside ? "--bars" : "--line");
      const high = (Math.log1p(count) / most) * tall, left = Math.floor(n * step);
      pen.fillRect(left, tall - high, Math.floor((n + 1) * step) - left, high);
    });
  };
  // Round values; of a logarithm round powers
  const drawnNumbers = (pen, tall, ratio, to, style) => {
    const { low, high } = page.about.histogram, values = ticks(low, high), texts = values.map((place) => short(scale().from(place)));
    drawnTicks(pen, { values, to, baseline: tall, width: element.width, ratio, color: style.getPropertyValue("--faint"), texts });
  };
  const drawnCurve = (pen, tall, ratio, to, style) => {
    const places = points().map(([one, tint, high]) => [to(one), (1 - Math.sqrt(high)) * tall, tint]);
    pen.strokeStyle = style.getPropertyValue("--text");
    pen.lineWidth = 1.5 * ratio;
    pen.beginPath();
    if (places.length) pen.moveTo(0, places[0][1]);
    for (const [x, y] of places) pen.lineTo(x, y);
    if (places.length) pen.lineTo(element.width, places.at(-1)[1]);
    pen.stroke();
    places.forEach(([x, y, tint], n) => {
      const radius = (n === chosen ? 6 : 4.5) * ratio;
      pen.beginPath();
      pen.arc(between(radius, x, element.width - radius), between(radius, y, tall - radius), radius, 0, 7);
      pen.fillStyle = tint;
      pen.fill();
      pen.strokeStyle = style.getPropertyValue(n === chosen ? "--accent" : "--text");
      pen.stroke();
    });
  };
  // The value under the pointer, how many voxels have it, and how opaque the look makes it
  const told = (event) => {
    if (!page.about?.histogram) return;
    const { counts, low, high } = page.about.histogram, place = valueAt(event), given = points();
    const count = counts[Math.min(counts.length - 1, Math.floor(((place - low) / (high - low || 1)) * counts.length))];
    const next = given.findIndex(([one]) => one > place), [a, b] = [given[next - 1] ?? given.at(-1), given[next] ?? given.at(-1)];
    const height = next === 0 ? given[0][2] : a && a[2] + (b === a ? 0 : ((place - a[0]) / (b[0] - a[0])) * (b[2] - a[2]));
    under.textContent = `value ${short(scale().from(place))} · ${count.toLocaleString("en")} voxels${a ? ` · opacity ${short(height)}` : ""}`;
  };
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    chosen = nearest(event);
    if (chosen >= 0) held = { n: chosen };
    else if (isOwn() || (known?.windowed === false && points().length > 1)) held = { x: event.clientX, y: event.clientY, points: points() };
    else from = valueAt(event);
    draw();
  });
  const drag = (event, moving) => {
    if (from !== null) { put(from, valueAt(event), moving); return; }
    if (held?.n !== undefined) {
      if (held.hasMoved || moving) moved(held.n, valueAt(event), opacityAt(event), moving);
      held.hasMoved = true;
      return;
    }
    if (!held || (!moving && !held.hasMoved)) return;
    held.hasMoved = true;
    const shift = ((event.clientX - held.x) / element.getBoundingClientRect().width) * span();
    const wide = Math.exp((event.clientY - held.y) / 100);
    const middle = (held.points[0][0] + held.points.at(-1)[0]) / 2;
    write(held.points.map(([one, ...rest]) => [middle + (one - middle) * wide + shift, ...rest]), moving);
  };
  element.addEventListener("pointermove", (event) => {
    told(event);
    if (from !== null || held) drag(event, true);
  });
  element.addEventListener("pointerleave", () => { under.textContent = ""; });
  element.addEventListener("pointerup", (event) => { drag(event, false); from = held = null; });
  element.addEventListener("dblclick", (event) => {
    const n = nearest(event);
    if (n >= 0) { chosen = n; removed(); }
    else if (page.settings.window !== undefined) page.changed("window", undefined);
    else added(valueAt(event), opacityAt(event));
  });
  element.addEventListener("keydown", (event) => {
    const last = points().length - 1;
    const across = { ArrowLeft: -span() / 50, ArrowRight: span() / 50 }[event.key];
    const up = { ArrowUp: 0.02, ArrowDown: -0.02 }[event.key];
    const point = points()[chosen];
    if (event.key === "]") chosen = Math.min(last, chosen + 1);
    else if (event.key === "[") chosen = Math.max(-1, chosen - 1);
    else if (event.key === "Delete") removed();
    else if (event.key === "Enter") added();
    else if (point && (across ?? up) !== undefined) moved(chosen, point[0] + (across ?? 0), point[2] + (up ?? 0), true);
    else if (across !== undefined && isOwn()) write(points().map(([one, ...rest]) => [one + across, ...rest]), true);
    else if (across !== undefined) {
      const range = windowEnds() ?? [page.about.histogram.low, page.about.histogram.high];
      if (event.shiftKey) put(range[0] - across, range[1] + across, true);
      else put(range[0] + across, range[1] + across, true);
    } else return;
    event.preventDefault();
    draw();
  });
  color.addEventListener("input", () => {
    const given = points();
    if (!given[chosen]) return;
    given[chosen] = [given[chosen][0], color.value, given[chosen][2]];
    write(given, true);
  });
  const typed = () => {
    const point = points()[chosen];
    if (point && value.value !== "" && opacity.value !== "") moved(chosen, scale().to(Number(value.value)), Number(opacity.value), false);
  };
  value.addEventListener("change", typed);
  opacity.addEventListener("change", typed);
  looks.addEventListener("change", () => {
    chosen = -1;
    if (looks.value) page.changed("transfer", looks.value);
    looks.value = "";
  });
  // The curve of looks that are not given by points is asked for once the picture is whole.
  const ask = () => {
    const key = JSON.stringify({ ...page.settings, camera: "" });
    if (!page.about.histogram || key === asked) return;
    asked = key;
    element.ariaBusy = "true";
    page.say("ask", { what: "points" });
  };
  const curve = (given) => { known = given; element.ariaBusy = "false"; draw(); };
  const forget = () => { asked = ""; known = null; };
  const offer = (names) => looks.replaceChildren(
    made("option", { value: "" }, "Looks…"), ...["auto", ...names].map((one) => made("option", { value: one }, one)));
  return { element, under, tools, draw, ask, curve, forget, offer, ends, spread, windowed, places: () => ends().map(scale().to), usual: () => known?.usual };
}
