// A picture beside the next ones, seen from the same camera, and their difference: one that is
// kept, or what a rival paints of the same options.

import { hung, made } from "./elements.js";

// Options that pictures side by side share
const LINKED = ["camera", "fov", "up", "fit", "corners", "move", "turn", "pose", "target-fov", "steady"];

export function compare(page) {
  let kept = null, rival = ""; // settings, or a name; neither: nothing is compared
  const other = pane("other"), apart = pane("difference");
  const button = made("button", { id: "compare", "aria-pressed": "false",
    title: "Keep this picture, and see the next ones beside it", onclick: () => begun(kept ? null : { ...page.settings }, "") }, "Compare");
  const rivals = made("select", { id: "rivals", hidden: true, "aria-label": "Compare with" });
  rivals.addEventListener("change", () => begun(null, rivals.value));

  function pane(name) {
    const image = made("img", { alt: name, draggable: false }), caption = made("div", { class: "caption" });
    return { element: made("figure", { class: "pane", id: name }, image, caption), image, caption };
  }

  // Rivals of the page; those that are not to be had say why.
  function offer(given) {
    const names = Object.entries(given ?? {});
    rivals.hidden = !names.length;
    rivals.replaceChildren(made("option", { value: "" }, "Beside…"), ...names.map(([name, absence]) =>
      made("option", { value: name, disabled: Boolean(absence), title: absence }, absence ? `${name} (not installed)` : name)));
  }

  function begun(given, name) {
    kept = given;
    rival = name;
    rivals.value = name;
    button.setAttribute("aria-pressed", String(Boolean(kept)));
    const both = Boolean(kept || rival);
    if (both) page.panes.append(other.element, apart.element);
    else { other.element.remove(); apart.element.remove(); }
    page.panes.classList.toggle("several", both);
    page.wish(false);
  }

  // What a wish for a picture says besides. Rivals paint when nothing moves, as they are slow.
  function wished(moving) {
    for (const one of [other, apart]) one.element.classList.toggle("stale", Boolean(rival && moving));
    if (rival) return moving ? {} : { rival };
    if (!kept) return {};
    const given = { ...kept };
    for (const key of LINKED) {
      if (key in page.settings) given[key] = page.settings[key]; else delete given[key];
    }
    return { other: given };
  }

  // What was changed since, as a caption has room for it.
  function differing() {
    const keys = [...new Set([...Object.keys(page.settings), ...Object.keys(kept)])];
    const found = keys.filter((key) => !LINKED.includes(key) && String(page.settings[key]) !== String(kept[key]));
    return found.map((key) => `${key} ${kept[key] ?? "as usual"}`.slice(0, 40)).join(", ");
  }

  function named(milliseconds) {
    if (!kept) return `${rival} · ${Math.round(milliseconds)} ms`;
    return `kept${differing() ? `: ${differing()}` : ""}`;
  }

  function framed(head, bytes) {
    if (!kept && !rival) return;
    const where = head.kind === "other" ? other : apart;
    hung(where.image, bytes, head.type);
    const decibels = head.decibels === null ? "equal" : `${head.decibels} dB`;
    where.caption.textContent = head.kind === "other"
      ? named(head.milliseconds) : `difference × ${head.gain} · ${decibels}`;
  }

  // Why there is no picture beside.
  function failed(text) {
    for (const one of [other, apart]) one.image.removeAttribute("src");
    other.caption.textContent = text;
    apart.caption.textContent = "";
  }

  return { buttons: [button, rivals], offer, wished, framed, failed };
}
