// Coefficients of a lens by hand: sliders that write the text of the option `lens`.

import { made, rounded } from "./elements.js";

const COEFFICIENTS = { k1: 0.5, k2: 0.5, p1: 0.05, p2: 0.05, k3: 0.5 }; // farthest from 0
const OTHER_PLACES = ["matrix", "corners", "map", "flow"]; // of a picture's warp
const BESIDE = "k="; // coefficients alone, where the camera is told otherwise

function numbersOf(text) {
  const numbers = String(text ?? "").replace(BESIDE, "").split(",").map(Number);
  return String(text ?? "") && numbers.every(Number.isFinite) ? numbers : [];
}

export function lens(page) {
  const isWarp = page.about.gestures === "corners";
  const sliders = Object.entries(COEFFICIENTS).map(([name, most]) => made("input", {
    type: "range", id: `lens-${name}`, min: String(-most), max: String(most), step: String(most / 500),
    "aria-label": `Lens, ${name}`, oninput: () => isWarp && put(true), onchange: () => put(false),
  }));
  const element = made("div", { class: "lens" },
    ...sliders.flatMap((slider) => [made("span", {}, slider.id.replace("lens-", "")), slider]));

  function put(moving) {
    const text = page.settings.lens, known = numbersOf(text), [across, down] = page.about.extent;
    const isBeside = String(text ?? "").startsWith(BESIDE) || (!isWarp && known.length < 8);
    const side = Math.max(across, down), camera = known.length < 8 ? [side, side, across / 2, down / 2] : known.slice(0, 4);
    const coefficients = sliders.map((slider) => rounded(Number(slider.value)));
    if (isWarp) for (const key of OTHER_PLACES) page.put(key, undefined);
    page.changed("lens", isBeside ? BESIDE + coefficients.join(",") : [...camera, ...coefficients].join(","), moving);
  }

  // Sliders as the text says; a file's coefficients are its own.
  function shown() {
    const text = page.settings.lens, known = numbersOf(text);
    const given = String(text ?? "").startsWith(BESIDE) ? known : known.slice(4);
    sliders.forEach((slider, n) => {
      if (slider !== document.activeElement) slider.value = String(given[n] ?? 0);
    });
  }

  shown();
  return { element, shown };
}
