// Numbers by a slider, or typed beside it.

import { between, made, rounded } from "./elements.js";

const FINE = 500; // steps of a slider

// Numbers of options: least, greatest, where an option that is not set begins, and its scale
const RANGES = {
  ambient: [0, 1], diffuse: [0, 1], specular: [0, 1], shininess: [1, 256, 32, "log"], "depth-cue": [0, 1],
  fov: [0, 120], "target-fov": [10, 150, 60], "point-size": [0.25, 8, 1, "log"], "disc-limit": [1, 64, 8, "log"],
  edl: [0, 2], "least-opacity": [0, 1], noise: [0, 0.1],
};

// The slider of an option; null: it has none.
export function rangeOf({ key, schema, default: usual }, about) {
  const types = [schema, ...(schema.anyOf ?? [])], isNumber = types.some((one) => one.type === "number");
  const limits = types.find((one) => one.minimum !== undefined && one.maximum !== undefined);
  if (key === "iso" && about.histogram && !about.histogram.scale) {
    const { low, high } = about.histogram;
    return { low, high, usual: (low + high) / 2 };
  }
  const [low, high, begin, scale] = RANGES[key] ?? (isNumber && limits ? [limits.minimum, limits.maximum] : []);
  return isNumber && low !== undefined ? { low, high, usual: usual ?? begin ?? low, isLog: scale === "log" } : null;
}

// A slider and a number, which say what is chosen (`wanted`: a number, and whether it goes on);
// `put` shows a number.
export function slider({ low, high, usual, isLog }, range, number, wanted) {
  let ends = [low, high], last = usual;
  // Positions of the slider: numbers, or steps of their logarithm
  const to = (one) => (isLog ? (Math.log(one / ends[0]) / Math.log(ends[1] / ends[0])) * FINE : one);
  const chosen = () => {
    const at = range.valueAsNumber;
    if (isLog) return Number((ends[0] * (ends[1] / ends[0]) ** (at / FINE)).toPrecision(3));
    return Number(at.toFixed(between(0, Math.ceil(-Math.log10((ends[1] - ends[0]) / FINE)), 12)));
  };
  const shown = () => {
    const [a, b] = isLog ? [0, FINE] : ends;
    Object.assign(range, { type: "range", min: String(a), max: String(b), step: String((b - a) / FINE || 1) });
    range.value = String(between(a, to(last), b));
    range.setAttribute("aria-valuetext", rounded(last));
  };
  shown();
  range.addEventListener("input", () => {
    last = chosen();
    number.value = rounded(last);
    range.setAttribute("aria-valuetext", number.value);
    wanted(last, true);
  });
  range.addEventListener("change", () => wanted(last, false));
  return {
    put: (value) => {
      last = Number.isFinite(value) ? value : usual;
      shown();
    },
    spread: (a, b) => { ends = [a, b]; shown(); },
  };
}

// A row with a name, a slider and a number of its own
export function row({ id, name, title, ...how }, wanted) {
  const range = made("input", { id, "aria-label": name });
  const number = made("input", { type: "number", step: "any", id: `${id}-number`, "aria-label": `${name}, as a number` });
  const held = slider(how, range, number, wanted);
  number.addEventListener("change", () => {
    if (number.value !== "" && Number.isFinite(number.valueAsNumber)) wanted(number.valueAsNumber, false);
  });
  const put = (value) => {
    held.put(value);
    number.value = rounded(value);
    number.dataset.shown = number.value;
  };
  put(how.usual);
  return { element: made("label", { class: "ranged", title: title ?? "" }, made("span", {}, name), range, number), put, spread: held.spread };
}
