// Window and level by dragging in the picture: to the right the window becomes wider, upward the
// level higher. A tool, or Ctrl with a drag. Of channels, and of clouds and particles in the colors
// of a colormap, the ends come with each picture: of the option `window`, or `range`.

import { short } from "./axis.js";
import { made } from "./elements.js";

const SHOWN = 2000; // ms for which the numbers stay

export function contrast(page) {
  const button = made("button", { id: "contrast", "aria-pressed": "false", hidden: true,
    "aria-label": "Window/level", title: "Window/level: drag in the picture, right for a wider window, up for a higher level (w)", onclick: turned }, "W/L");
  const readout = made("div", { class: "readout", id: "readout", role: "status", hidden: true });
  let timer = 0, known = null; // known: ends of the range in the last picture, and whether it is logarithmic
  const isOn = () => button.getAttribute("aria-pressed") === "true";

  function turned() {
    button.setAttribute("aria-pressed", String(!isOn()));
    page.el.classList.toggle("contrast", isOn());
  }

  // Whether a drag that begins with an event sets the window
  const takes = (event) => !button.hidden && event.button === 0 && (isOn() || event.ctrlKey);

  function ranged(dx, dy) {
    const [to, from] = known.log ? [Math.log, Math.exp] : [(one) => one, (one) => one];
    const option = known.option ?? "range", joint = option === "range" ? "," : "..";
    const given = String(page.settings[option] ?? "").split(joint).map(Number);
    const [low, high] = (given.length === 2 && given.every(Number.isFinite) ? given : known.ends).map(to);
    const half = (Math.max(high - low, 1e-9) * Math.exp(dx / 200)) / 2, middle = (low + high) / 2 - (dy / 200) * (high - low);
    const ends = [middle - half, middle + half].map((one) => Number(from(one).toPrecision(6)));
    if (ends[0] < ends[1]) page.changed(option, ends.join(joint), true);
    return ends;
  }

  function dragged(dx, dy) {
    if (page.about.histogram) page.windowed(dx, dy);
    const [low, high] = page.about.histogram ? page.window() : ranged(dx, dy);
    readout.textContent = `window ${short(high - low)} · level ${short((low + high) / 2)}`;
    readout.hidden = false;
    clearTimeout(timer);
    timer = setTimeout(() => { readout.hidden = true; }, SHOWN);
  }

  function framed({ range, preview }) {
    if (!preview) known = range ?? null;
    begin();
  }

  const begin = () => { button.hidden = !page.about.histogram && !known; };
  page.canvas.append(readout);
  return { button, takes, dragged, turned: () => button.hidden || turned(), begin, framed };
}
