// Window and level by dragging in the picture: to the right the window becomes wider, upward the
// level higher. A tool, or Ctrl with a drag.

import { short } from "./axis.js";
import { made } from "./elements.js";

const SHOWN = 2000; // ms for which the numbers stay

export function contrast(page) {
  const button = made("button", { id: "contrast", "aria-pressed": "false", hidden: true,
    "aria-label": "Window/level", title: "Window/level: drag in the picture, right for a wider window, up for a higher level (w)", onclick: turned }, "W/L");
  const readout = made("div", { class: "readout", id: "readout", role: "status", hidden: true });
  let timer = 0;
  const isOn = () => button.getAttribute("aria-pressed") === "true";

  function turned() {
    button.setAttribute("aria-pressed", String(!isOn()));
    page.el.classList.toggle("contrast", isOn());
  }

  // Whether a drag that begins with an event sets the window
  const takes = (event) => !button.hidden && event.button === 0 && (isOn() || event.ctrlKey);

  function dragged(dx, dy) {
    page.windowed(dx, dy);
    const [low, high] = page.window();
    readout.textContent = `window ${short(high - low)} · level ${short((low + high) / 2)}`;
    readout.hidden = false;
    clearTimeout(timer);
    timer = setTimeout(() => { readout.hidden = true; }, SHOWN);
  }

  page.canvas.append(readout);
  return { button, takes, dragged, turned: () => button.hidden || turned(), begin: () => { button.hidden = !page.about.histogram; } };
}
