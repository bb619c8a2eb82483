// A sheet of keys and gestures, which `?` opens.

import { made } from "./elements.js";

const HISTOGRAM = [
  ["Histogram: drag", "choose the window; on a point of the curve: move it"],
  ["Histogram: double-click", "add a point; on a point: remove it"],
  ["Histogram: [ and ]", "select a point; arrows move it, Enter adds one, Delete removes it"],
];
const ALL = [
  ["click, Enter", "tell what is seen there, or in the middle"],
  ["Ctrl+Z, Ctrl+Shift+Z", "undo and redo"],
  ["Tab", "go to the next control or handle; arrows move a handle"],
  ["?", "open this sheet; Esc closes it"],
];

export function help(page) {
  const dialog = made("dialog", { id: "help", "aria-label": "Keys and gestures" });
  const button = made("button", { id: "help-open", title: "Keys and gestures (?)", "aria-label": "Keys and gestures", onclick: opened }, "?");

  function rows() {
    const { histogram, film, slices } = page.about;
    return [
      ...page.steering.help,
      ...(page.contrast.button.hidden ? [] : [["Window/level (w), or Ctrl and drag", "right: wider window, up: higher level"]]),
      ...(histogram ? HISTOGRAM : []),
      ...(slices ? [["Slices: click; wheel, arrows, Page Up/Down", "move the other slices; scroll through them"]] : []),
      ["s", "axes and scale bar"],
      ...(film ? [["Keyframe", "keep this camera; Export has the film through all"]] : []),
      ...ALL,
    ];
  }

  function opened() {
    if (!page.about || dialog.open) return;
    dialog.replaceChildren(
      made("strong", {}, "Keys and gestures"),
      made("dl", {}, ...rows().flatMap(([keys, what]) => [made("dt", {}, keys), made("dd", {}, what)])),
      made("button", { id: "help-close", onclick: () => dialog.close() }, "Close"));
    dialog.showModal();
  }

  return { dialog, button, opened };
}
