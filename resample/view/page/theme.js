// Dark or light, as the system has it until the switch chooses.

import { made } from "./elements.js";

const KEPT = "hybrid-resample theme";

export function theme(el, redraw) {
  const system = matchMedia("(prefers-color-scheme: light)");
  const button = made("button", { id: "theme", title: "Dark or light page", "aria-label": "Dark or light page", onclick: turned }, "◐");
  let chosen = "";
  try { chosen = localStorage.getItem(KEPT) ?? ""; } catch { /* the browser keeps nothing */ }

  function put() {
    el.dataset.theme = chosen || (system.matches ? "light" : "dark");
    redraw();
  }

  function turned() {
    chosen = el.dataset.theme === "light" ? "dark" : "light";
    try { localStorage.setItem(KEPT, chosen); } catch { /* until the page is closed */ }
    put();
  }

  system.addEventListener("change", put);
  return { button, put };
}
