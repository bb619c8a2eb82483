// A picture that is kept beside the next ones, seen from the same camera, and their difference.

import { hung, made } from "./elements.js";

// Options that pictures side by side share
const LINKED = ["camera", "fov", "up", "fit", "corners", "move", "turn", "pose", "target-fov", "steady"];

export function compare(page) {
  let kept = null; // settings
  const other = pane("other"), apart = pane("difference");
  const button = made("button", { id: "compare", "aria-pressed": "false",
    title: "Keep this picture, and see the next ones beside it", onclick: () => keep(kept ? null : { ...page.settings }) }, "Compare");

  function pane(name) {
    const image = made("img", { alt: name, draggable: false }), caption = made("div", { class: "caption" });
    return { element: made("figure", { class: "pane", id: name }, image, caption), image, caption };
  }

  function keep(given) {
    kept = given;
    button.setAttribute("aria-pressed", String(Boolean(kept)));
    if (kept) page.panes.append(other.element, apart.element);
    else { other.element.remove(); apart.element.remove(); }
    page.panes.classList.toggle("several", Boolean(kept));
    page.wish(false);
  }

  // What a wish for a picture says besides.
  function wished() {
    if (!kept) return {};
    const given = { ...kept };
    for (const key of LINKED) {
      if (key in page.settings) given[key] = page.settings[key]; else delete given[key];
    }
    return { other: given };
  }

  // What was changed since, as a caption has room for it.
  function differing() {
    const keys = [...new Set([...Object.keys(page.settings), ...Object.keys(kept ?? {})])];
    const found = keys.filter((key) => !LINKED.includes(key) && String(page.settings[key]) !== String(kept[key]));
    return found.map((key) => `${key} ${kept[key] ?? "as usual"}`.slice(0, 40)).join(", ");
  }

  function framed(head, bytes) {
    const where = head.kind === "other" ? other : apart;
    hung(where.image, bytes, head.type);
    const decibels = head.decibels === null ? "equal" : `${head.decibels} dB`;
    where.caption.textContent = head.kind === "other"
      ? `kept${kept && differing() ? `: ${differing()}` : ""}` : `difference × ${head.gain} · ${decibels}`;
  }

  return { button, wished, framed };
}
