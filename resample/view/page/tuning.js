// What the look spreads over, and how opaque it is: sliders that write `window` or `transfer`, and
// `opacity-unit`.

import { made } from "./elements.js";
import { row } from "./sliders.js";

const DENSER = 64; // times more and less opaque

export function tuning(page, look) {
  const range = { low: 0, high: 1, usual: 0 };
  const low = row({ ...range, id: "window-low", name: "low", title: "Lower end of the window; slices show it black" },
    (value, moving) => spread(value, look.ends()[1], moving));
  const high = row({ ...range, id: "window-high", name: "high", title: "Upper end of the window; slices show it white" },
    (value, moving) => spread(look.ends()[0], value, moving));
  const opacity = row({ id: "opacity", name: "opacity", low: 1 / DENSER, high: DENSER, usual: 1, isLog: true,
    title: "Opacity as a multiple of the default; it sets opacity-unit" }, (factor, moving) => {
    const { usual } = look;
    if (usual() && factor > 0) page.changed("opacity-unit", Math.abs(factor - 1) < 0.005 ? undefined : Number((usual() / factor).toPrecision(6)), moving);
  });
  const element = made("div", { class: "tuning" }, low.element, high.element, opacity.element);

  function spread(from, to, moving) {
    if (Number.isFinite(from + to) && from < to) look.spread(from, to, moving); else shown();
  }

  function shown() {
    if (!page.about?.histogram) return;
    const { low: least, high: most } = page.about.histogram, ends = look.ends(), unit = Number(page.settings["opacity-unit"]);
    low.spread(least, most);
    high.spread(least, most);
    low.put(ends[0]);
    high.put(ends[1]);
    opacity.element.hidden = !look.usual();
    opacity.put(unit > 0 && look.usual() ? look.usual() / unit : 1);
  }

  return { element, shown };
}
