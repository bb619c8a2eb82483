// Undo and redo: settings and slices, one entry per change that has come to rest. A drag is one change.

import { made } from "./elements.js";

const MOST = 200; // entries

export function history(page) {
  const undo = button("undo", "↶", "Undo (Ctrl+Z)", -1), redo = button("redo", "↷", "Redo (Ctrl+Shift+Z)", 1);
  let entries = [], at = -1; // settings with the width that corners are px of, and where slices are
  let held = false; // the pointer is down

  function button(id, text, title, by) {
    return made("button", { id, title, "aria-label": title, disabled: true, onclick: () => stepped(by) }, text);
  }

  const now = () => ({ settings: structuredClone(page.settings), slices: page.slicesAt(), width: page.size().width });
  const isSame = (a, b) => ["settings", "slices"].every((part) => JSON.stringify(a[part]) === JSON.stringify(b[part]));

  function shown() {
    undo.disabled = at <= 0;
    redo.disabled = at >= entries.length - 1;
  }

  // Settings have come to rest.
  function recorded() {
    if (held || !page.about) return;
    const entry = now();
    if (at >= 0 && isSame(entry, entries[at])) return;
    entries = [...entries.slice(0, at + 1), entry].slice(-MOST);
    at = entries.length - 1;
    shown();
  }

  // The same settings in other words, as after the window has another size
  function amended() {
    if (at >= 0) entries[at] = now();
  }

  function stepped(by) {
    held = false;
    recorded();
    const entry = entries[at + by];
    if (!entry) return;
    at += by;
    shown();
    page.slicesPut(entry.slices);
    page.replaced(page.steering.rescaled?.(entry.settings, entry.width) ?? structuredClone(entry.settings));
    amended();
  }

  // Texts that are being written have an undo of their own.
  const isWriting = (field) => field?.matches?.("input:not([type=range], [type=checkbox]), textarea") && field.value !== field.dataset.shown;

  page.el.addEventListener("pointerdown", () => { held = true; }, true);
  for (const end of ["pointerup", "pointercancel"]) {
    window.addEventListener(end, () => { held = false; }, true);
  }
  page.el.getRootNode().addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.altKey || isWriting(event.composedPath()[0])) return;
    const key = event.key.toLowerCase();
    if (key !== "z" && key !== "y") return;
    event.preventDefault();
    event.stopPropagation(); // a notebook has steps of its own
    stepped(key === "y" || event.shiftKey ? 1 : -1);
  });
  return { buttons: [undo, redo], recorded, amended, isHeld: () => held };
}
