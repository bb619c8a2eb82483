// A picture that a command would paint, and its options. State is the options alone: what the page
// shows, exports and saves is made from them.
//
// `show` makes the `page`, which its parts share: elements (`el`, `canvas`, `image`, `panes`,
// `picked`), what is shown (`about`, `settings`), and what parts do to it. `page.steering` is what
// gestures mean here: `orbit`, `corners` or `walk`, as `about.gestures` says.

import { bounds } from "./bounds.js";
import { compare } from "./compare.js";
import { corners } from "./corners.js";
import { download, hung, made } from "./elements.js";
import { exporting } from "./exports.js";
import { fields } from "./fields.js";
import { gestures } from "./gestures.js";
import { histogram } from "./histogram.js";
import { magnifier } from "./magnifier.js";
import { orbit, VIEWS } from "./orbit.js";
import { walk } from "./walk.js";

const STILL = 160; // ms after the last gesture, from which on the whole picture is asked for
const LARGEST = 1024; // px of a side that is asked for
const STEERINGS = { orbit, corners, walk };

// What the viewer sends: words, or bytes with words about them before them.
function apart(data) {
  if (typeof data === "string") return [JSON.parse(data), null];
  const length = new DataView(data).getUint32(0, true);
  return [JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length))), new Uint8Array(data, 4 + length)];
}

// Show a page in an element. `connect` is given what is done with what comes (`heard`), when the
// link is lost (`closed`) and when options come from elsewhere (`replaced`); it returns what sends.
export function show(el, connect) {
  let number = 0, timer = 0, waiting = false, again = false;
  let whole = null; // settings of the last whole picture that was asked for
  let wishedSize = ""; // that was asked for last
  let latest = 0; // number of the wish that was sent last

  const image = made("img", { alt: "The picture", draggable: false });
  const message = made("div", { class: "message", role: "status", "aria-live": "polite" });
  const picked = made("span", { class: "picked", id: "picked" });
  const canvas = made("div", { class: "canvas", tabIndex: 0, role: "application" }, image, message, picked);
  const panes = made("div", { class: "panes" }, canvas);
  const page = {
    el, canvas, image, panes, picked, about: null, settings: {}, steering: null,
    size, placeOf, note, say, wish, put, changed, replaced,
  };

  const options = fields(page), look = histogram(page), beside = compare(page);
  const glass = magnifier(page), cuts = bounds(page), exports = exporting(page);
  const badge = made("span", { class: "badge", id: "badge" }, "…");
  const views = made("select", { "aria-label": "View from", id: "views" },
    made("option", { value: "" }, "View from…"), ...VIEWS.map((v) => made("option", { value: v }, v)));
  const bar = made("div", { class: "bar" }, badge, views, ...cuts.buttons, ...beside.buttons, glass.button, exports.keyframe, exports.button,
    made("button", { id: "save-png", onclick: () => say("save", { suffix: ".png" }) }, "PNG"),
    made("button", { id: "save-exr", onclick: () => say("save", { suffix: ".exr" }) }, "EXR"),
    made("button", { id: "reset", onclick: () => replaced({ ...page.about?.settings }) }, "Reset"));
  const side = made("aside", { class: "side" });
  el.append(made("div", { class: "stage" }, panes, bar), side, exports.dialog);

  // Sizes and places: of the picture, px

  function size() {
    const box = page.steering.frame(), most = LARGEST / Math.max(box.width, box.height, 1);
    const scale = Math.min(window.devicePixelRatio || 1, most);
    return {
      width: Math.max(8, Math.round(box.width * scale)),
      height: Math.max(8, Math.round(box.height * scale)),
    };
  }

  const spelledSize = () => Object.values(size()).join("x");

  function placeOf(event) {
    const box = page.steering.frame(), { width, height } = size();
    return { x: ((event.clientX - box.left) / box.width) * width, y: ((event.clientY - box.top) / box.height) * height };
  }

  // Handles over the picture
  function placed() {
    page.steering.placed?.();
    cuts.placed();
  }

  // Said to the viewer

  function say(kind, more = {}) {
    if (!page.about) return;
    number += 1;
    link.send(JSON.stringify({ kind, number, settings: page.settings, ...size(), ...more }));
  }

  // One picture is under way at a time; of what is wished meanwhile the last is remembered.
  function wish(moving) {
    if (!page.about) return;
    clearTimeout(timer);
    canvas.setAttribute("aria-busy", "true");
    if (moving) timer = setTimeout(() => wish(false), STILL);
    if (waiting && moving) { again = true; return; }
    waiting = true;
    wishedSize = spelledSize();
    if (!moving) whole = { ...page.settings };
    say("draw", { moving, ...beside.wished(moving) });
    latest = number;
  }

  // The answer to a wish has come; it may be the last.
  function answered(head) {
    waiting = false;
    if (again) { again = false; wish(true); }
    else if (!head.preview && head.number === latest) canvas.setAttribute("aria-busy", "false");
  }

  // Options: `put` sets one, `changed` also asks for the picture, `replaced` sets all of them

  function put(key, value) {
    if (value === undefined || value === null || value === "") delete page.settings[key];
    else page.settings[key] = value;
    options.put(key);
  }

  function changed(key, value, moving = false) {
    put(key, value);
    if (key === "window" || key === "transfer") look.draw();
    placed();
    wish(moving);
  }

  function replaced(given) {
    if (!page.about) return;
    page.settings = given;
    options.putAll();
    look.draw();
    placed();
    wish(false);
  }

  // Told by the viewer

  function begin(given) {
    const gesture = given.gestures ?? "orbit", isBack = page.about !== null;
    page.about = given;
    page.steering ??= STEERINGS[gesture](page);
    page.steering.begin?.();
    cuts.begin();
    canvas.setAttribute("aria-label", `Picture: ${page.steering.hint}`);
    views.hidden = gesture !== "orbit";
    exports.keyframe.hidden = !given.film;
    beside.offer(given.rivals);
    replaced(isBack ? page.settings : { ...given.settings });
    build();
    page.steering.resized?.();
    placed();
  }

  function build() {
    const { title, subtitle, names } = page.about;
    document.title = title;
    side.replaceChildren(
      made("h1", {}, title), made("div", { class: "subtitle" }, subtitle ?? ""),
      ...(page.about.histogram ? [look.element, made("div", { class: "hint" },
        "Drag a point of the curve to change the look (a double-click adds or takes one away), or elsewhere for the window."),
      look.tools] : []),
      ...options.build(),
    );
    look.offer(names?.transfer ?? []);
    look.draw();
  }

  function told(given) {
    if (given.kind === "about") begin(given);
    if (given.kind === "error") { answered(given); note(given.text, "message"); }
    if (given.kind === "other") beside.failed(given.text);
    if (given.kind === "notice") note(given.text, "message notice");
    if (given.kind === "picked") {
      picked.textContent = Object.entries(given.found).map(([k, v]) => `${k} ${v}`).join(" · ") || "nothing here";
      cuts.picked(given.found);
    }
    if (given.kind === "told" && given.what === "points") look.curve(given.told);
    if (given.kind === "exported") exports.exported(given.texts);
  }

  function framed(head, bytes) {
    if (head.kind === "file") { note("", "message"); download(head.name, bytes); return; }
    if (head.kind !== "frame") { beside.framed(head, bytes); return; }
    note("", "message");
    if (!head.preview) {
      look.ask();
      if (whole) link.settled?.(whole);
    }
    hung(image, bytes, head.type);
    cuts.framed(head.view);
    image.dataset.number = head.number;
    image.dataset.preview = head.preview;
    badge.className = `badge ${head.preview ? "preview" : "final"}`;
    badge.textContent = `${head.preview ? "preview" : "final"} · ${Math.round(head.milliseconds)} ms`;
    answered(head);
  }

  function heard(data) {
    const [words, bytes] = apart(data);
    if (bytes) framed(words, bytes); else told(words);
  }

  function closed() {
    waiting = false;
    look.forget();
    note("The viewer has ended, or is out of reach; trying again.", "message");
  }

  function note(text, kind) {
    message.className = kind;
    message.textContent = text;
  }

  const link = connect({ heard, closed, replaced });
  gestures(page);
  views.addEventListener("change", () => {
    if (views.value) changed("camera", views.value);
    views.value = "";
  });
  new ResizeObserver(() => {
    if (!page.about) return;
    page.steering.resized?.();
    look.draw();
    placed();
    if (wishedSize !== spelledSize()) wish(true);
  }).observe(canvas);
  return () => link.close?.();
}
