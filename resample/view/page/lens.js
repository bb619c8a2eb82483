// Coefficients of a lens by hand: sliders that write the text of the option `lens`.

import { made, rounded } from "./elements.js";
import { row } from "./sliders.js";

const COEFFICIENTS = { k1: 0.5, k2: 0.5, p1: 0.05, p2: 0.05, k3: 0.5 }; // farthest from 0
const OTHER_PLACES = ["matrix", "corners", "map", "flow"]; // of a picture's warp
const BESIDE = "k="; // coefficients alone, where the camera is told otherwise

function numbersOf(text) {
  const numbers = String(text ?? "").replace(BESIDE, "").split(",").map(Number);
  return String(text ?? "") && numbers.every(Number.isFinite) ? numbers : [];
}

export function lens(page) {
  const isWarp = page.about.gestures === "corners";
  const names = Object.keys(COEFFICIENTS);
  const rows = names.map((name, n) => row({ id: `lens-${name}`, name, low: -COEFFICIENTS[name], high: COEFFICIENTS[name], usual: 0 },
    (value, moving) => { if (isWarp || !moving) put(value, n, moving); }));
  const element = made("div", { class: "indented" }, ...rows.map((one) => one.element));

  function put(value, which, moving) {
    const text = page.settings.lens, known = numbersOf(text), [across, down] = page.about.extent;
    const isBeside = String(text ?? "").startsWith(BESIDE) || (!isWarp && known.length < 8);
    const side = Math.max(across, down), camera = known.length < 8 ? [side, side, across / 2, down / 2] : known.slice(0, 4);
    const coefficients = given().map((one, n) => rounded(n === which ? value : one));
    if (isWarp) for (const key of OTHER_PLACES) page.put(key, undefined);
    page.changed("lens", isBeside ? BESIDE + coefficients.join(",") : [...camera, ...coefficients].join(","), moving);
  }

  // Coefficients as the text says; a file's are its own.
  function given() {
    const text = page.settings.lens, known = numbersOf(text);
    const told = String(text ?? "").startsWith(BESIDE) ? known : known.slice(4);
    return names.map((_, n) => told[n] ?? 0);
  }

  function shown() {
    given().forEach((one, n) => rows[n].put(one));
  }

  shown();
  return { element, shown };
}
