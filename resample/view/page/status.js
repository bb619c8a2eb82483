// What the shown picture is: a badge that says preview, final or rendering, a bar of progress, and
// a placeholder until there is a picture. "final" is said only of the picture of the options shown.

import { made } from "./elements.js";

const PATIENCE = 300; // ms after which a bar appears; quick pictures show none

export function status(page) {
  const { canvas } = page;
  const badge = made("span", { class: "badge", id: "badge", role: "status" });
  const bar = made("progress", { class: "progress", id: "progress", max: "1", hidden: true, "aria-label": "Rendering" });
  const empty = made("div", { class: "placeholder", id: "placeholder" }, "Waiting for the first picture…");
  let head = null, timer = 0, percent = "";

  function said(kind, text) {
    badge.className = `badge ${kind}`;
    badge.textContent = text;
  }

  function busy(on) {
    canvas.setAttribute("aria-busy", String(on));
    clearTimeout(timer);
    percent = "";
    bar.hidden = true;
    bar.removeAttribute("value"); // of unknown length
    if (on) timer = setTimeout(() => { bar.hidden = false; }, PATIENCE);
  }

  const rendering = () => said("busy", head ? `${head.preview ? "preview" : "previous picture"} · rendering…${percent}` : `rendering…${percent}`);

  // A picture is asked for; the one shown is of other options.
  function begun() {
    if (canvas.getAttribute("aria-busy") !== "true") busy(true);
    rendering();
  }

  function progressed(share) {
    if (canvas.getAttribute("aria-busy") !== "true") return; // the picture has overtaken it
    bar.hidden = false;
    bar.value = Math.max(share, bar.hasAttribute("value") ? bar.value : 0);
    percent = ` ${Math.round(100 * bar.value)} %`;
    rendering();
  }

  // A picture came; others may follow.
  function framed(given) {
    head = given;
    empty.remove();
    page.image.hidden = false;
    if (head.preview) said("preview", `preview · ${Math.round(head.milliseconds)} ms`);
  }

  // The answer to the last wish: a whole picture, or an error
  function ended(given) {
    busy(false);
    if (given.kind === "frame") { said("final", `final · ${Math.round(given.milliseconds)} ms`); return; }
    said("failed", head ? "previous picture · not rendered" : "not rendered");
    if (!head) empty.textContent = "There is no picture yet.";
  }

  function lost() {
    busy(true);
    said("failed", head ? "previous picture · disconnected" : "disconnected");
  }

  page.image.hidden = true;
  canvas.append(empty, bar, badge);
  busy(true);
  rendering();
  return { begun, progressed, framed, ended, lost };
}
