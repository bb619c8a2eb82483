// A picture that a command would paint, and its options. State is the options alone: what the page
// shows, exports and saves is made from them.
//
// `show` makes the `page`, which its parts share: elements (`el`, `canvas`, `image`, `panes`,
// `picked`), what is shown (`about`, `settings`), and what parts do to it. `page.steering` is what
// gestures mean here: `orbit`, `corners` or `walk`, as `about.gestures` says.

import { bounds } from "./bounds.js";
import { compare } from "./compare.js";
import { contrast } from "./contrast.js";
import { corners } from "./corners.js";
import { download, hung, made } from "./elements.js";
import { exporting } from "./exports.js";
import { fields } from "./fields.js";
import { filling } from "./fill.js";
import { gestures } from "./gestures.js";
import { help } from "./help.js";
import { histogram } from "./histogram.js";
import { history } from "./history.js";
import { legend } from "./legend.js";
import { magnifier } from "./magnifier.js";
import { marks } from "./marks.js";
import { measure } from "./measure.js";
import { BEGIN, orbit, VIEWS } from "./orbit.js";
import { slices } from "./slices.js";
import { status } from "./status.js";
import { theme } from "./theme.js";
import { tuning } from "./tuning.js";
import { walk } from "./walk.js";

const STILL = 160; // ms after the last gesture, from which on the whole picture is asked for
const SHARP = 1024; // px of a side up to which pixels of the screen are asked for, beyond those of the page
const LARGEST = 1400; // px of a side that is asked for; of pictures, which begin 1:1, more
const LARGEST_PICTURE = 2048;
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
  let number = 0, timer = 0, leaf = 0, waiting = false, again = false;
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
    size, placeOf, note, say, wish, put, changed, replaced, fitted,
    // What slices and lines ask of each other, of the look and of the camera
    window: () => look.ends(), places: () => look.places(), toward: (way) => cuts.toward(way), projected: (point) => cuts.projected(point),
    measuring: () => ruler.isOn(), marks: () => ruler.places(), marked: (place) => ruler.marked(place), linesMoved: () => sliced.lines(),
    slicesAt: () => sliced.at(), slicesPut: (voxel) => sliced.put(voxel), leafed, amended: () => past.amended(),
    windowed: (dx, dy) => look.windowed(dx, dy), helped: () => sheet.opened(), scaled: () => scales.turned(),
  };

  const options = fields(page), look = histogram(page), beside = compare(page), past = history(page);
  const glass = magnifier(page), cuts = bounds(page), exports = exporting(page), fill = filling(page);
  const sliced = slices(page), ruler = measure(page), names = legend(page), scales = marks(page);
  const state = status(page), sheet = help(page);
  page.contrast = contrast(page);
  const tuned = tuning(page, look), light = theme(el, () => { look.draw(); ruler.drawn(); });
  const views = menu("views", "View…", "View from", VIEWS, (name) => { put("camera", name); fitted(); });
  const saves = menu("save", "Save…", "Save the picture", ["PNG", "EXR"], (name) => say("save", { suffix: `.${name.toLowerCase()}` }));
  const fit = made("button", { id: "fit", title: "Fit it into the window (0)", onclick: fitted }, "Fit");
  const exact = made("button", { id: "exact", title: "Actual size: one texel per pixel (1, double-click)", onclick: () => page.steering.exact() }, "1:1");
  const bar = made("div", { class: "bar" },
    ...past.buttons, views, fit, exact, page.contrast.button, ...cuts.buttons, sliced.button, ruler.button, scales.button, ...beside.buttons, glass.button,
    made("span", { class: "push" }), exports.keyframe, exports.button, saves,
    made("button", { id: "reset", title: "Back to the first view and options", onclick: reset }, "Reset"), light.button, sheet.button);
  const side = made("aside", { class: "side" }), stage = made("div", { class: "stage" }, panes);
  el.append(bar, stage, side, exports.dialog, sheet.dialog);
  light.put();

  // A list of things to do, by a name each.
  function menu(id, text, label, names, chosen) {
    const list = made("select", { id, "aria-label": label }, made("option", { value: "" }, text),
      ...names.map((one) => made("option", { value: one }, one)));
    list.addEventListener("change", () => {
      if (list.value) chosen(list.value);
      list.value = "";
    });
    return list;
  }

  // Sizes and places: of the picture, px

  function size() {
    const box = page.steering.frame(), long = Math.max(box.width, box.height, 1), ratio = window.devicePixelRatio || 1;
    const scale = page.steering.exact ? Math.min(ratio, LARGEST_PICTURE / long)
      : Math.max(Math.min(ratio, SHARP / long), Math.min(1, LARGEST / long));
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
    ruler.placed();
    scales.drawn();
  }

  // Said to the viewer

  function say(kind, more = {}) {
    if (!page.about) return;
    number += 1;
    link.send(JSON.stringify({ kind, number, settings: page.settings, ...size(), ...more }));
    return number;
  }

  // One picture is under way at a time; of what is wished meanwhile the last is remembered.
  function wish(moving) {
    if (!page.about) return;
    clearTimeout(timer);
    fill.stopped();
    state.begun();
    if (moving) timer = setTimeout(rested, STILL);
    if (waiting && moving) { again = true; return; }
    waiting = true;
    wishedSize = spelledSize();
    if (!moving) {
      whole = { ...page.settings };
      past.recorded();
    }
    say("draw", { moving, ...beside.wished(moving) });
    latest = number;
  }

  // Slices have moved, and the picture stays as it is.
  function leafed(moving) {
    clearTimeout(leaf);
    if (moving) leaf = setTimeout(past.recorded, STILL); else past.recorded();
  }

  // Nothing has moved for a while; of a drag that goes on, the picture alone is whole.
  function rested() { wish(false); }

  // The answer to a wish has come; it may be the last.
  function answered(head) {
    waiting = false;
    if (again) { again = false; wish(true); }
    else if (!head.preview && head.number === latest) state.ended(head);
  }

  // Options: `put` sets one, `changed` also asks for the picture, `replaced` sets all of them

  function put(key, value) {
    if (value === undefined || value === null || value === "") delete page.settings[key];
    else page.settings[key] = value;
    options.put(key);
    if (key === "camera" || key === "up") options.put("light"); // which may be at the eye
  }

  // The histogram and the sliders below
  function drawn() {
    look.draw();
    tuned.shown();
    sliced.refreshed();
  }

  function changed(key, value, moving = false) {
    put(key, value);
    if (key === "window" || key === "transfer") drawn(); else tuned.shown();
    placed();
    wish(moving);
  }

  // The object is as large as the picture has room for.
  function fitted() {
    if (!page.about) return;
    if (!page.steering.filled) { (page.steering.fitted ?? page.steering.home)(); return; }
    state.begun();
    fill.begun(() => changed("camera", page.settings.camera));
  }

  // As it began, handles and marks included
  function reset() {
    if (!page.about) return;
    cuts.reset();
    sliced.reset();
    ruler.reset();
    picked.textContent = "";
    replaced(page.steering.atStart?.() ?? { ...page.about.settings });
  }

  function replaced(given) {
    if (!page.about) return;
    page.settings = given;
    sliced.read();
    options.putAll();
    drawn();
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
    sliced.begin();
    ruler.begin(stage);
    canvas.setAttribute("aria-label", `Picture: ${page.steering.hint}`);
    views.hidden = !page.steering.filled;
    exact.hidden = !page.steering.exact;
    exports.keyframe.hidden = !given.film;
    page.contrast.begin();
    scales.begin();
    beside.offer(given);
    const opens = () => replaced(isBack ? page.settings : page.steering.atStart?.() ?? { ...given.settings });
    if (!isBack && given.fills && given.settings.camera === BEGIN) filled(opens); else opens();
    build();
    page.steering.resized?.();
    placed();
  }

  // The camera that it begins with is found.
  function filled(then) {
    page.settings = { ...page.about.settings };
    state.begun();
    fill.begun(() => {
      page.about.settings.camera = page.settings.camera;
      then();
    });
  }

  function build() {
    const { title, subtitle, names } = page.about;
    document.title = title;
    side.replaceChildren(
      made("h1", {}, title), made("div", { class: "subtitle" }, subtitle ?? ""),
      ...(page.about.histogram ? [look.element, look.under, look.tools, tuned.element, made("div", { class: "hint" },
        "Drag a point of the curve to edit the transfer function (double-click to add or remove one); drag elsewhere to set the window.")] : []),
      ...options.build(),
    );
    look.offer(names?.transfer ?? []);
    drawn();
  }

  // A place of the scene was picked, or nothing.
  function marked(position) {
    const middle = page.about.box?.middle ?? [0, 0, 0];
    const words = position?.split(",");
    ruler.marked(words ? middle.map((part, axis) => Number(words[axis] ?? part) - part) : null); // of pictures x and y
  }

  function told(given) {
    if (given.kind === "about") begin(given);
    if (given.kind === "error") { fill.failed(given.number); answered(given); note(given.text, "message"); }
    if (given.kind === "other") beside.failed(given.text);
    if (given.kind === "notice") note(given.text, "message notice");
    if (given.kind === "progress" && given.number === latest) state.progressed(given.share);
    if (given.kind === "picked") {
      picked.textContent = Object.entries(given.found).map(([k, v]) => `${k} ${v}`).join(" · ") || "nothing here";
      marked(given.found.position);
    }
    if (given.kind === "measured") ruler.told(given);
    if (given.kind === "told" && given.what === "points") { look.curve(given.told); tuned.shown(); sliced.refreshed(); }
    if (given.kind === "exported") exports.exported(given.texts);
  }

  function framed(head, bytes) {
    if (head.kind === "file") { note("", "message"); download(head.name, bytes); return; }
    if (head.kind === "slice") { sliced.framed(head, bytes); return; }
    if (head.kind !== "frame") { beside.framed(head, bytes); return; }
    if (fill.takes(head, bytes)) return;
    note(head.plain ? "Nothing is visible with these options: all pixels are alike." : "", head.plain ? "message notice" : "message");
    if (!head.preview) {
      look.ask();
      if (whole) link.settled?.(whole);
    }
    hung(image, bytes, head.type);
    cuts.framed(head.view);
    ruler.placed();
    image.dataset.number = head.number;
    image.dataset.preview = head.preview;
    names.shown(head.legend);
    page.contrast.framed(head);
    scales.shown(head.view);
    state.framed(head);
    answered(head);
  }

  function heard(data) {
    const [words, bytes] = apart(data);
    if (bytes) framed(words, bytes); else told(words);
  }

  function closed() {
    waiting = false;
    look.forget();
    state.lost();
    note("The connection to the viewer is lost; reconnecting.", "message");
  }

  function note(text, kind) {
    message.className = kind;
    message.textContent = text;
  }

  const link = connect({ heard, closed, replaced });
  gestures(page);
  new ResizeObserver(() => {
    if (!page.about) return;
    page.steering.resized?.();
    past.amended();
    look.draw();
    placed();
    if (wishedSize !== spelledSize()) wish(true);
  }).observe(canvas);
  return () => link.close?.();
}
