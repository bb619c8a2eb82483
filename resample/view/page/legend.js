// Names and colors of the volumes, or channels, that a picture shows together.

import { made } from "./elements.js";

export function legend(page) {
  const list = made("ul", { class: "legend", id: "legend", "aria-label": "Volumes and their colors", hidden: true });
  page.canvas.append(list);

  // Colors over the range of values, low to high
  function swatch(colors) {
    const box = made("span", { class: "swatch" });
    box.style.background = colors.length > 1 ? `linear-gradient(to right, ${colors.join(", ")})` : colors[0];
    return box;
  }

  function shown(given) {
    if (given === undefined) return; // a preview's are those before
    list.hidden = given.length < 2;
    list.replaceChildren(...given.map(({ name, colors }) => made("li", {}, swatch(colors), name)));
  }

  return { shown };
}
