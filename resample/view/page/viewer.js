// A picture that a command would paint, and its options. State is the options alone: what the page
// shows, exports and saves is made from them.

const STILL = 160; // ms after the last gesture, from which on the whole picture is asked for
const LARGEST = 1024; // px of a side that is asked for
const OPEN = ["Look", "Camera", "Picture"]; // headings that begin unfolded
// Options that pictures side by side share
const LINKED = ["camera", "fov", "up", "fit", "corners", "move", "turn", "pose", "target-fov", "steady"];
const HINTS = {
  orbit: "arrows turn it, plus and minus zoom, shift and arrows move it",
  corners: "arrows move it, plus and minus make it larger and smaller",
  walk: "arrows move the camera, shift and arrows turn it, plus and minus go ahead and back",
};
const GLASS = 21, LARGER = 8; // px that the magnifier shows, and how much larger
const NEAR = 12; // px within which a point of a curve is taken
const VIEWS = ["front", "back", "left", "right", "top", "bottom", "corner"];
const NAMED = {
  front: [0, 0], back: [180, 0], right: [90, 0], left: [-90, 0], top: [0, 90], bottom: [0, -90],
  corner: [45, 35.264389682754654],
};

function made(kind, given = {}, ...children) {
  const element = document.createElement(kind);
  for (const [name, value] of Object.entries(given)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && typeof value !== "string") element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

function rounded(number) {
  return String(Number(number.toPrecision(6)));
}

// azimuth/elevation/zoom/right/up as numbers, and back as text.
function parsed(camera) {
  if (camera in NAMED) return [...NAMED[camera], 1, 0, 0];
  const parts = String(camera).split("/").map(Number);
  if (parts.some(Number.isNaN) || parts.length < 2) return null;
  return [parts[0], parts[1], parts[2] ?? 1, parts[3] ?? 0, parts[4] ?? 0];
}

// Points of a look: value, color and opacity each; null: it is not given by points.
function pointsOf(transfer) {
  const parts = String(transfer ?? "").split(",").map((part) => part.split("/"));
  if (parts.some((part) => part.length !== 3)) return null;
  const points = parts.map(([value, color, opacity]) => [Number(value), color, Number(opacity)]);
  return points.some(([value, , opacity]) => Number.isNaN(value + opacity)) ? null : points;
}

function spelledPoints(points) {
  return points.map(([value, color, opacity]) => `${rounded(value)}/${color}/${rounded(opacity)}`).join(",");
}

function between(low, number, high) {
  return Math.min(high, Math.max(low, number));
}

function spelled([azimuth, elevation, zoom, right, up]) {
  const parts = [azimuth, elevation, zoom];
  if (right || up) parts.push(right, up);
  return parts.map(rounded).join("/");
}

export function show(el, connect) {
  let about = null, settings = {}, kept = null, number = 0, timer = 0, url = "", waiting = false, again = null;
  let shown = { width: 1, height: 1 };
  let keyframes = []; // cameras
  let whole = null; // settings of the last whole picture that was asked for
  let wished = ""; // the size that was asked for last
  const fields = new Map();

  const image = made("img", { alt: "The picture", draggable: false });
  const message = made("div", { class: "message", role: "status", "aria-live": "polite" });
  const glass = made("canvas", { class: "glass", id: "glass", width: GLASS * LARGER, height: GLASS * LARGER, hidden: true });
  const picked = made("span", { class: "picked", id: "picked" });
  const canvas = made("div", {
    class: "canvas", tabIndex: 0, role: "application",
  }, image, glass, message, picked);
  const badge = made("span", { class: "badge", id: "badge" }, "…");
  const views = made("select", { "aria-label": "View from", id: "views" },
    made("option", { value: "" }, "View from…"), ...VIEWS.map((v) => made("option", { value: v }, v)));
  const other = pane("other"), apart = pane("difference");
  const panes = made("div", { class: "panes" }, canvas);
  const compare = made("button", { id: "compare", "aria-pressed": "false",
    title: "Keep this picture, and see the next ones beside it", onclick: () => keep(kept ? null : { ...settings }) }, "Compare");
  const magnify = made("button", { id: "magnify", "aria-pressed": "false",
    title: "Show pixels under the pointer enlarged, and their levels", onclick: () => magnifying(glass.hidden) }, "Magnifier");
  const keyframe = made("button", { id: "keyframe", hidden: true,
    title: "Remember where the camera is; Export gives the film through all keyframes", onclick: () => remembered([...keyframes, settings.camera ?? "30/20/1"]) }, "Keyframe");
  const bar = made("div", { class: "bar" }, badge, views, compare, magnify,
    keyframe,
    made("button", { id: "export", onclick: () => say("export", { keyframes }) }, "Export"),
    made("button", { id: "save-png", onclick: () => say("save", { suffix: ".png" }) }, "PNG"),
    made("button", { id: "save-exr", onclick: () => say("save", { suffix: ".exr" }) }, "EXR"),
    made("button", { id: "reset", onclick: () => replaced({ ...about.settings }) }, "Reset"));
  const side = made("aside", { class: "side" });
  const dialog = made("dialog", { id: "exports" });
  el.append(made("div", { class: "stage" }, panes, bar), side, dialog);

  const link = connect({ opened: () => wish(false), told, frame: framed, closed });

  const walks = () => about?.gestures === "walk";

  // What of the canvas the picture fills: all of it, or what has the sides of a camera's picture.
  function frame() {
    const box = canvas.getBoundingClientRect();
    if (!walks()) return { left: box.left, top: box.top, width: box.width, height: box.height };
    const [across, down] = about.extent, scale = Math.min(box.width / across, box.height / down);
    const width = scale * across, height = scale * down;
    return { left: box.left + (box.width - width) / 2, top: box.top + (box.height - height) / 2, width, height };
  }

  function size() {
    const box = frame(), most = LARGEST / Math.max(box.width, box.height, 1);
    const scale = Math.min(window.devicePixelRatio || 1, most);
    return {
      width: Math.max(8, Math.round(box.width * scale)),
      height: Math.max(8, Math.round(box.height * scale)),
    };
  }

  const spelledSize = () => Object.values(size()).join("x");

  // Where in the picture an event is, px of the picture.
  function placeOf(event) {
    const box = frame(), { width, height } = size();
    return { x: ((event.clientX - box.left) / box.width) * width, y: ((event.clientY - box.top) / box.height) * height };
  }

  function say(kind, more = {}) {
    if (!about) return;
    number += 1;
    link.send(JSON.stringify({ kind, number, settings, ...size(), ...more }));
  }

  // One picture is under way at a time; of what is wished meanwhile the last is remembered.
  function wish(moving) {
    if (!about) return;
    clearTimeout(timer);
    if (moving) timer = setTimeout(() => wish(false), STILL);
    if (waiting && moving) { again = true; return; }
    waiting = true;
    wished = spelledSize();
    if (!moving) whole = { ...settings };
    say("draw", { moving, ...(kept ? { other: beside() } : {}) });
  }

  // Pixels under the pointer, enlarged

  let under = null; // where the pointer is, as a share of the picture

  function magnifying(on) {
    glass.hidden = !on;
    magnify.setAttribute("aria-pressed", String(on));
    picked.textContent = "";
    magnified();
  }

  function magnified() {
    if (glass.hidden || !under || !image.naturalWidth) return;
    const x = Math.floor(under.x * image.naturalWidth), y = Math.floor(under.y * image.naturalHeight);
    const pen = glass.getContext("2d", { willReadFrequently: true }), half = (GLASS - 1) / 2;
    pen.imageSmoothingEnabled = false;
    pen.clearRect(0, 0, glass.width, glass.height);
    pen.drawImage(image, x - half, y - half, GLASS, GLASS, 0, 0, glass.width, glass.height);
    const [red, green, blue, alpha] = pen.getImageData((half + 0.5) * LARGER, (half + 0.5) * LARGER, 1, 1).data;
    pen.strokeStyle = getComputedStyle(el).getPropertyValue("--accent");
    pen.strokeRect(half * LARGER - 0.5, half * LARGER - 0.5, LARGER + 1, LARGER + 1);
    const inside = x >= 0 && y >= 0 && x < image.naturalWidth && y < image.naturalHeight;
    const levels = [red, green, blue, ...(alpha < 255 ? [alpha] : [])].join(" ");
    picked.textContent = inside ? `pixel ${x}, ${y} · levels ${levels}` : "";
  }

  canvas.addEventListener("pointermove", (event) => {
    const box = frame(), outer = canvas.getBoundingClientRect();
    under = { x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height };
    const beside = event.clientX - outer.left > outer.width / 2 ? -glass.width - 20 : 20;
    glass.style.left = `${event.clientX - outer.left + beside}px`;
    glass.style.top = `${between(0, event.clientY - outer.top - glass.height / 2, outer.height - glass.height)}px`;
    magnified();
  });
  image.addEventListener("load", () => magnified());

  // Pictures side by side

  function pane(name) {
    const image = made("img", { alt: name, draggable: false }), caption = made("div", { class: "caption" });
    return { element: made("figure", { class: "pane", id: name }, image, caption), image, caption, url: "" };
  }

  function hung(where, bytes, type) {
    URL.revokeObjectURL(where.url);
    where.url = URL.createObjectURL(new Blob([bytes], { type }));
    where.image.src = where.url;
  }

  function beside() {
    const given = { ...kept };
    for (const key of LINKED) {
      if (key in settings) given[key] = settings[key]; else delete given[key];
    }
    return given;
  }

  function keep(given) {
    kept = given;
    compare.setAttribute("aria-pressed", String(Boolean(kept)));
    if (kept) panes.append(other.element, apart.element);
    else { other.element.remove(); apart.element.remove(); }
    panes.classList.toggle("several", Boolean(kept));
    wish(false);
  }

  // What was changed since, as a caption has room for it.
  function differing() {
    const keys = [...new Set([...Object.keys(settings), ...Object.keys(kept ?? {})])];
    const found = keys.filter((key) => !LINKED.includes(key) && String(settings[key]) !== String(kept[key]));
    return found.map((key) => `${key} ${kept[key] ?? "as usual"}`.slice(0, 40)).join(", ");
  }

  function told(given) {
    if (given.kind === "about") begin(given);
    if (given.kind === "error") { waiting = false; note(given.text, "message"); }
    if (given.kind === "notice") note(given.text, "message notice");
    if (given.kind === "picked") {
      picked.textContent = Object.entries(given.found).map(([k, v]) => `${k} ${v}`).join(" · ") || "nothing here";
    }
    if (given.kind === "told" && given.what === "points") histogram.curve(given.told);
    if (given.kind === "exported") exported(given.texts);
    if (given.kind === "settings" && about) replaced(given.settings);
  }

  // Corners, which are px, go with the picture's width.
  let width = 0;
  function spread() {
    const now = size().width, points = corners();
    if (about?.gestures === "corners" && points && width && now !== width) {
      put(points.map((one) => one.map((part) => (part * now) / width)), true);
    }
    width = now;
  }

  function begin(given) {
    about = given;
    width = about.width ?? width;
    canvas.setAttribute("aria-label", `Picture: ${HINTS[about.gestures ?? "orbit"]}`);
    views.hidden = about.gestures !== undefined;
    keyframe.hidden = !about.film;
    if (about.gestures === "corners") {
      canvas.append(...handles);
      if (about.settings.corners === "") about.settings.corners = fitted();
    }
    replaced({ ...about.settings });
    build();
    spread();
    placed();
  }

  function framed(head, bytes) {
    if (head.kind === "file") { note("", "message"); download(head.name, bytes); return; }
    if (head.kind === "other" || head.kind === "difference") {
      const where = head.kind === "other" ? other : apart;
      hung(where, bytes, head.type);
      const decibels = head.decibels === null ? "equal" : `${head.decibels} dB`;
      where.caption.textContent = head.kind === "other"
        ? `kept${kept && differing() ? `: ${differing()}` : ""}` : `difference × ${head.gain} · ${decibels}`;
      return;
    }
    waiting = false;
    note("", "message");
    if (!head.preview) {
      histogram.ask();
      if (whole) link.settled?.(whole);
    }
    URL.revokeObjectURL(url);
    url = URL.createObjectURL(new Blob([bytes], { type: head.type }));
    image.src = url;
    image.dataset.number = head.number;
    image.dataset.preview = head.preview;
    badge.className = `badge ${head.preview ? "preview" : "final"}`;
    badge.textContent = `${head.preview ? "preview" : "final"} · ${Math.round(head.milliseconds)} ms`;
    if (again) { again = null; wish(true); }
  }

  function closed() {
    waiting = false;
    histogram.forget();
    note("The viewer has ended, or is out of reach; trying again.", "message");
  }

  function note(text, kind) {
    message.className = kind;
    message.textContent = text;
  }

  function download(name, bytes) {
    const address = URL.createObjectURL(new Blob([bytes]));
    made("a", { href: address, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
  }

  function remembered(cameras) {
    keyframes = cameras;
    keyframe.textContent = keyframes.length ? `Keyframe (${keyframes.length})` : "Keyframe";
  }

  function exported(texts) {
    dialog.replaceChildren(
      ...Object.entries(texts).flatMap(([name, text]) => [
        made("strong", {}, name[0].toUpperCase() + name.slice(1)),
        made("button", { onclick: () => navigator.clipboard?.writeText(text) }, "Copy"),
        made("pre", { id: `export-${name}` }, text),
      ]),
      ...(texts.keyframes ? [
        made("button", { id: "film-make", onclick: () => { say("film", { keyframes }); dialog.close(); } }, "Make film.mp4"),
        made("button", { id: "film-stop", onclick: () => say("film", { keyframes: [] }) }, "Stop the film"),
        made("button", { id: "keyframes-save", onclick: () => download("keyframes.toml", texts.keyframes) }, "Save keyframes.toml"),
        made("button", { id: "keyframes-forget", onclick: () => { remembered([]); dialog.close(); } }, "Forget keyframes"),
      ] : []),
      made("button", { id: "close", onclick: () => dialog.close() }, "Close"),
    );
    if (!dialog.open) dialog.showModal();
  }

  // Options

  function replaced(given) {
    settings = given;
    for (const [key, field] of fields) field.put(settings[key]);
    histogram.draw();
    placed();
    wish(false);
  }

  function changed(key, value, moving = false) {
    if (value === undefined || value === null || value === "") delete settings[key];
    else settings[key] = value;
    fields.get(key)?.put(settings[key]);
    if (key === "window" || key === "transfer") histogram.draw();
    if (key === "corners") placed();
    wish(moving);
  }

  function field(control) {
    const { key, schema, help } = control;
    const types = [schema, ...(schema.anyOf ?? [])];
    const choices = types.map((one) => one.enum).find(Boolean);
    const kind = types.map((one) => one.type).find((one) => one && one !== "null");
    const initial = control.default ?? "";
    let input, read = () => input.value;
    if (choices) {
      const open = types.some((one) => one.type === "null");
      input = made("select", {}, ...(open ? [made("option", { value: "" }, "—")] : []),
        ...choices.map((one) => made("option", { value: String(one) }, String(one))));
    } else if (kind === "boolean") {
      input = made("input", { type: "checkbox" });
      read = () => (input.checked === Boolean(control.default) ? undefined : input.checked);
    } else if (kind === "number" || kind === "integer") {
      input = made("input", { type: "number", step: kind === "integer" ? "1" : "any" });
      read = () => (input.value === "" ? undefined : Number(input.value));
    } else if (kind === "array") {
      input = made("input", { type: "text", placeholder: "several: a; b" });
      read = () => input.value.split(";").map((one) => one.trim()).filter(Boolean);
    } else {
      input = made("input", { type: "text", placeholder: initial === null ? "" : String(initial) });
    }
    if (key === "transfer") input.setAttribute("list", "transfers");
    input.id = `option-${key}`;
    input.addEventListener("change", () => {
      const value = read();
      const usual = Array.isArray(value) ? value.length === 0 : value === control.default || (choices && value === "");
      changed(key, usual ? undefined : value);
    });
    const label = made("label", { title: help }, made("span", {}, key), input);
    const put = (value) => {
      label.classList.toggle("changed", value !== undefined);
      const now = value ?? control.default ?? "";
      if (input.type === "checkbox") input.checked = Boolean(now);
      else input.value = Array.isArray(now) ? now.join("; ") : String(now);
    };
    fields.set(key, { put });
    put(settings[key]);
    return label;
  }

  function build() {
    document.title = about.title;
    fields.clear();
    const headings = new Map();
    for (const control of about.controls) {
      if (!headings.has(control.heading)) headings.set(control.heading, []);
      headings.get(control.heading).push(field(control));
    }
    side.replaceChildren(
      made("h1", {}, about.title), made("div", { class: "subtitle" }, about.subtitle ?? ""),
      ...(about.histogram ? [histogram.element, made("div", { class: "hint" },
        "Drag a point of the curve to change the look (a double-click adds or takes one away), or elsewhere for the window."),
      histogram.tools] : []),
      made("datalist", { id: "transfers" }, ...(about.transfers ?? []).map((one) => made("option", { value: one }))),
      ...[...headings].map(([name, labels]) =>
        made("details", { open: OPEN.includes(name) || about.gestures === "corners" }, made("summary", {}, name), ...labels)),
    );
    histogram.offer(about.transfers ?? []);
    histogram.draw();
  }

  // Histogram, over which the window and the points of the look are dragged

  const histogram = (() => {
    const element = made("canvas", { class: "histogram", id: "histogram", tabIndex: 0,
      "aria-label": "Histogram: drag to choose a window, arrows move it; brackets choose a point of the look, "
        + "arrows then move it, Delete takes it away, Enter adds one" });
    const color = made("input", { type: "color", id: "point-color", "aria-label": "Color of the point" });
    const value = made("input", { type: "number", step: "any", id: "point-value", "aria-label": "Value of the point" });
    const opacity = made("input", { type: "number", step: "any", min: 0, max: 1, id: "point-opacity", "aria-label": "Opacity of the point" });
    const looks = made("select", { id: "looks", "aria-label": "Looks" });
    const tools = made("div", { class: "tools" }, looks, color, value, opacity,
      made("button", { id: "point-add", title: "Add a point", "aria-label": "Add a point", onclick: () => added() }, "+"),
      made("button", { id: "point-remove", title: "Take the point away", "aria-label": "Take the point away", onclick: () => removed() }, "−"));
    let from = null, known = null, asked = "", chosen = -1, held = null;
    const span = () => about.histogram.high - about.histogram.low || 1;
    const shareOf = (event) => {
      const box = element.getBoundingClientRect();
      return between(0, (event.clientX - box.left) / box.width, 1);
    };
    const valueAt = (event) => about.histogram.low + shareOf(event) * span();
    // Opacities are drawn by their square root, as small ones matter most.
    const opacityAt = (event) => {
      const box = element.getBoundingClientRect();
      return between(0, 1 - (event.clientY - box.top) / box.height, 1) ** 2;
    };
    const points = () => pointsOf(settings.transfer) ?? (known?.points ?? []).map((one) => [...one]);
    const isOwn = () => pointsOf(settings.transfer) !== null;
    const ends = () => {
      const parts = String(settings.window ?? "").split("/").map(Number);
      if (parts.length !== 2 || parts.some(Number.isNaN)) return null;
      return [parts[0] - parts[1] / 2, parts[0] + parts[1] / 2];
    };
    const put = (a, b, moving) => {
      const low = Math.min(a, b), width = Math.abs(b - a);
      if (width > span() / 500) changed("window", `${rounded(low + width / 2)}/${rounded(width)}`, moving);
    };
    // The look becomes its points, in data units, which no window spreads.
    const write = (given, moving) => {
      if (!isOwn()) {
        changed("window", undefined, true);
        if (known?.unit && settings["opacity-unit"] === undefined) changed("opacity-unit", known.unit, true);
      }
      changed("transfer", spelledPoints(given), moving);
    };
    const moved = (n, to, height, moving) => {
      const given = points();
      if (!given[n]) return;
      const low = given[n - 1]?.[0] ?? -Infinity, high = given[n + 1]?.[0] ?? Infinity;
      given[n] = [between(low, to, high), given[n][1], between(0, height, 1)];
      write(given, moving);
    };
    const added = (at, height) => {
      const given = points();
      let n = given.findIndex(([one]) => at !== undefined && one > at);
      if (at === undefined) n = between(1, chosen + 1, Math.max(1, given.length - 1));
      if (n < 0) n = given.length;
      const near = given[n - 1] ?? given[n], next = given[n] ?? near;
      if (!near) return;
      given.splice(n, 0, [at ?? (near[0] + next[0]) / 2, near[1], height ?? (near[2] + next[2]) / 2]);
      chosen = n;
      write(given, false);
    };
    const removed = () => {
      const given = points();
      if (given.length < 2 || !given[chosen]) return;
      given.splice(chosen, 1);
      chosen = Math.min(chosen, given.length - 1);
      write(given, false);
    };
    const nearest = (event) => {
      const box = element.getBoundingClientRect();
      const far = points().map(([one, , high]) => Math.hypot(
        event.clientX - box.left - between(0, (one - about.histogram.low) / span(), 1) * box.width,
        event.clientY - box.top - (1 - Math.sqrt(high)) * box.height));
      const n = far.indexOf(Math.min(...far));
      return far[n] <= NEAR ? n : -1;
    };
    const fill = () => {
      const point = points()[chosen];
      for (const input of [color, value, opacity]) input.disabled = !point;
      if (!point) return;
      if (/^#[0-9a-f]{6}$/i.test(point[1])) color.value = point[1];
      if (document.activeElement !== value) value.value = rounded(point[0]);
      if (document.activeElement !== opacity) opacity.value = rounded(point[2]);
    };
    const draw = () => {
      if (!about?.histogram) return;
      const ratio = window.devicePixelRatio || 1, box = element.getBoundingClientRect();
      element.width = Math.max(1, box.width * ratio);
      element.height = Math.max(1, box.height * ratio);
      const pen = element.getContext("2d"), { counts, low } = about.histogram;
      const most = Math.log1p(Math.max(...counts, 1)), step = element.width / counts.length;
      const style = getComputedStyle(el);
      const range = ends();
      counts.forEach((count, n) => {
        const at = low + ((n + 0.5) / counts.length) * span();
        const inside = !range || (at >= range[0] && at <= range[1]);
        pen.fillStyle = style.getPropertyValue(inside ? "--bars" : "--line");
        const tall = (Math.log1p(count) / most) * element.height;
        pen.fillRect(n * step, element.height - tall, Math.max(1, step), tall);
      });
      const places = points().map(([one, tint, high]) => [
        between(0, (one - low) / span(), 1) * element.width, (1 - Math.sqrt(high)) * element.height, tint]);
      pen.strokeStyle = style.getPropertyValue("--text");
      pen.lineWidth = 1.5 * ratio;
      pen.beginPath();
      if (places.length) pen.moveTo(0, places[0][1]);
      for (const [x, y] of places) pen.lineTo(x, y);
      if (places.length) pen.lineTo(element.width, places.at(-1)[1]);
      pen.stroke();
      places.forEach(([x, y, tint], n) => {
        const radius = (n === chosen ? 6 : 4.5) * ratio;
        pen.beginPath();
        pen.arc(between(radius, x, element.width - radius), between(radius, y, element.height - radius), radius, 0, 7);
        pen.fillStyle = tint;
        pen.fill();
        pen.strokeStyle = style.getPropertyValue(n === chosen ? "--accent" : "--text");
        pen.stroke();
      });
      fill();
    };
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      chosen = nearest(event);
      if (chosen >= 0) held = { n: chosen };
      else if (isOwn()) held = { x: event.clientX, y: event.clientY, points: points() };
      else from = valueAt(event);
      draw();
    });
    const drag = (event, moving) => {
      if (from !== null) { put(from, valueAt(event), moving); return; }
      if (held?.n !== undefined) {
        if (held.hasMoved || moving) moved(held.n, valueAt(event), opacityAt(event), moving);
        held.hasMoved = true;
        return;
      }
      if (!held || (!moving && !held.hasMoved)) return;
      held.hasMoved = true;
      const shift = ((event.clientX - held.x) / element.getBoundingClientRect().width) * span();
      const wide = Math.exp((event.clientY - held.y) / 100);
      const middle = (held.points[0][0] + held.points.at(-1)[0]) / 2;
      write(held.points.map(([one, ...rest]) => [middle + (one - middle) * wide + shift, ...rest]), moving);
    };
    element.addEventListener("pointermove", (event) => (from !== null || held) && drag(event, true));
    element.addEventListener("pointerup", (event) => { drag(event, false); from = held = null; });
    element.addEventListener("dblclick", (event) => {
      const n = nearest(event);
      if (n >= 0) { chosen = n; removed(); }
      else if (settings.window !== undefined) changed("window", undefined);
      else added(valueAt(event), opacityAt(event));
    });
    element.addEventListener("keydown", (event) => {
      const last = points().length - 1;
      const across = { ArrowLeft: -span() / 50, ArrowRight: span() / 50 }[event.key];
      const up = { ArrowUp: 0.02, ArrowDown: -0.02 }[event.key];
      const point = points()[chosen];
      if (event.key === "]") chosen = Math.min(last, chosen + 1);
      else if (event.key === "[") chosen = Math.max(-1, chosen - 1);
      else if (event.key === "Delete") removed();
      else if (event.key === "Enter") added();
      else if (point && (across ?? up) !== undefined) moved(chosen, point[0] + (across ?? 0), point[2] + (up ?? 0), true);
      else if (across !== undefined && isOwn()) write(points().map(([one, ...rest]) => [one + across, ...rest]), true);
      else if (across !== undefined) {
        const range = ends() ?? [about.histogram.low, about.histogram.high];
        if (event.shiftKey) put(range[0] - across, range[1] + across, true);
        else put(range[0] + across, range[1] + across, true);
      } else return;
      event.preventDefault();
      draw();
    });
    color.addEventListener("input", () => {
      const given = points();
      if (!given[chosen]) return;
      given[chosen] = [given[chosen][0], color.value, given[chosen][2]];
      write(given, true);
    });
    const typed = () => {
      const point = points()[chosen];
      if (point && value.value !== "" && opacity.value !== "") moved(chosen, Number(value.value), Number(opacity.value), false);
    };
    value.addEventListener("change", typed);
    opacity.addEventListener("change", typed);
    looks.addEventListener("change", () => {
      chosen = -1;
      if (looks.value) changed("transfer", looks.value);
      looks.value = "";
    });
    // The curve of looks that are not given by points is asked for once the picture is whole.
    const ask = () => {
      const key = JSON.stringify({ ...settings, camera: "" });
      if (!about.histogram || key === asked) return;
      asked = key;
      say("ask", { what: "points" });
    };
    const curve = (given) => { known = given; draw(); };
    const forget = () => { asked = ""; known = null; };
    const offer = (names) => looks.replaceChildren(
      made("option", { value: "" }, "Looks…"), ...["auto", ...names].map((one) => made("option", { value: one }, one)));
    return { element, tools, draw, ask, curve, forget, offer };
  })();

  // Gestures on the picture: what they do is written into the camera

  function steered(change, moving = true) {
    const camera = parsed(settings.camera ?? "30/20/1");
    if (!camera) { note("The camera is a file; choose a view first.", "message"); return; }
    change(camera);
    changed("camera", spelled(camera), moving);
  }

  // Corners of a picture, px of the target, which are dragged one by one or all together
  const handles = [0, 1, 2, 3].map((n) => made("button", {
    class: "handle", id: `corner-${n}`,
    "aria-label": `Corner ${n + 1}: drag it, or move it with the arrows`,
  }));

  function corners() {
    const points = String(settings.corners ?? "").trim().split(/\s+/).map((one) => one.split(",").map(Number));
    const whole = points.length === 4 && points.every((one) => one.length === 2 && one.every(Number.isFinite));
    return whole ? points : null;
  }

  function put(points, moving) {
    changed("corners", points.map((one) => one.map(rounded).join(",")).join(" "), moving);
  }

  function placed() {
    if (about?.gestures !== "corners") return;
    const box = canvas.getBoundingClientRect(), { width } = size(), points = corners();
    handles.forEach((handle, n) => {
      handle.hidden = !points;
      if (!points) return;
      handle.style.left = `${(points[n][0] / width) * box.width}px`;
      handle.style.top = `${(points[n][1] / width) * box.width}px`;
    });
  }

  function fitted() {
    const { width, height } = size(), [across, down] = about.extent;
    const scale = 0.8 * Math.min(width / across, height / down);
    const x = (width - scale * across) / 2, y = (height - scale * down) / 2;
    const right = x + scale * across, bottom = y + scale * down;
    return [[x, y], [right, y], [right, bottom], [x, bottom]].map((one) => one.map(rounded).join(",")).join(" ");
  }

  handles.forEach((handle, n) => {
    const move = (dx, dy) => {
      const points = corners(), per = size().width / canvas.getBoundingClientRect().width;
      if (!points) return;
      points[n] = [points[n][0] + dx * per, points[n][1] + dy * per];
      put(points, true);
    };
    let last = null;
    handle.addEventListener("pointerdown", (event) => {
      event.stopPropagation();
      handle.setPointerCapture(event.pointerId);
      last = [event.clientX, event.clientY];
    });
    handle.addEventListener("pointermove", (event) => {
      if (!last) return;
      move(event.clientX - last[0], event.clientY - last[1]);
      last = [event.clientX, event.clientY];
    });
    handle.addEventListener("pointerup", (event) => { event.stopPropagation(); last = null; });
    handle.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-2, 0], ArrowRight: [2, 0], ArrowUp: [0, -2], ArrowDown: [0, 2] }[event.key];
      if (!by) return;
      event.preventDefault();
      event.stopPropagation();
      move(...by);
    });
  });

  // Steps of a camera near a picture with depth: to the right, down and ahead, scene units, and
  // turns to the right and up, degrees. What is in the middle distance stays where it is.
  function walked(change) {
    const [move, turn] = ["move", "turn"].map((key) => {
      const parts = String(settings[key] ?? "").split(",").map(Number);
      return parts.length === 3 && parts.every(Number.isFinite) ? parts : [0, 0, 0];
    });
    change(move, turn);
    if (turn.some(Boolean)) settings.turn = turn.map(rounded).join(",");
    else delete settings.turn;
    fields.get("turn")?.put(settings.turn);
    changed("move", move.map(rounded).join(","), true);
  }

  function stepped(dx, dy) {
    const [near, middle] = about.distance, per = (0.6 * near) / frame().width;
    walked((move, turn) => {
      move[0] -= dx * per;
      move[1] -= dy * per;
      turn[0] += (Math.atan(dx * per / middle) * 180) / Math.PI;
      turn[1] -= (Math.atan(dy * per / middle) * 180) / Math.PI;
    });
  }

  function looked(dx, dy) {
    const per = 40 / frame().width; // degrees
    walked((move, turn) => {
      turn[0] -= dx * per;
      turn[1] += dy * per;
    });
  }

  function advanced(factor) {
    const far = Math.log(factor) * about.distance[0] * 0.5;
    walked((move, [yaw, pitch]) => {
      const [a, b] = [yaw, pitch].map((one) => (one * Math.PI) / 180);
      move[0] += far * Math.sin(a) * Math.cos(b);
      move[1] -= far * Math.sin(b);
      move[2] += far * Math.cos(a) * Math.cos(b);
    });
  }

  function turned(dx, dy) {
    if (walks()) { stepped(dx, dy); return; }
    if (about.gestures === "corners") { panned(dx, dy); return; }
    steered((c) => {
      c[0] -= dx * 0.5;
      c[1] = between(-90, c[1] + dy * 0.5, 90);
    });
  }

  function panned(dx, dy) {
    if (walks()) { looked(dx, dy); return; }
    const box = canvas.getBoundingClientRect(), side = Math.min(box.width, box.height);
    if (about.gestures === "corners") {
      const per = size().width / box.width;
      const points = corners()?.map(([x, y]) => [x + dx * per, y + dy * per]);
      if (points) put(points, true);
      return;
    }
    steered((c) => { c[3] += dx / side; c[4] -= dy / side; });
  }

  function zoomed(factor) {
    if (walks()) { advanced(factor); return; }
    if (about.gestures === "corners") {
      const points = corners(), { width, height } = size();
      const around = ([x, y]) => [width / 2 + factor * (x - width / 2), height / 2 + factor * (y - height / 2)];
      if (points) put(points.map(around), true);
      return;
    }
    steered((c) => { c[2] = between(1e-3, c[2] * factor, 1e3); });
  }

  function home() {
    if (walks()) walked((move, turn) => { move.fill(0); turn.fill(0); });
    else if (about.gestures === "corners") put(fitted().split(" ").map((one) => one.split(",").map(Number)), false);
    else changed("camera", "30/20/1");
  }

  let dragged = null, travelled = 0;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    dragged = [event.clientX, event.clientY];
    travelled = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!dragged) return;
    const dx = event.clientX - dragged[0], dy = event.clientY - dragged[1];
    dragged = [event.clientX, event.clientY];
    travelled += Math.abs(dx) + Math.abs(dy);
    if (travelled < 3) return;
    if (event.shiftKey || event.buttons & 6) panned(dx, dy); else turned(dx, dy);
  });
  canvas.addEventListener("pointerup", (event) => {
    dragged = null;
    if (travelled >= 3) return;
    say("pick", placeOf(event));
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoomed(Math.exp(-event.deltaY / 600));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const step = 12, by = {
      ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step],
    }[event.key];
    if (by) event.shiftKey ? panned(...by) : turned(...by);
    else if (event.key === "+" || event.key === "=") zoomed(1.15);
    else if (event.key === "-") zoomed(1 / 1.15);
    else if (event.key === "Home") home();
    else return;
    event.preventDefault();
  });
  views.addEventListener("change", () => {
    if (views.value) changed("camera", views.value);
    views.value = "";
  });
  new ResizeObserver(() => {
    spread();
    histogram.draw();
    placed();
    if (wished !== spelledSize()) wish(true);
  }).observe(canvas);
  return () => link.close?.();
}

// What the viewer sends: words, or bytes with words about them before them.
function heard(data, hooks) {
  if (typeof data === "string") { hooks.told(JSON.parse(data)); return; }
  const length = new DataView(data).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  hooks.frame(head, new Uint8Array(data, 4 + length));
}

// A socket that opens itself again; `hooks` are told what comes through it.
export function socket(address) {
  return (hooks) => {
    let open = null;
    const dial = () => {
      open = new WebSocket(address);
      open.binaryType = "arraybuffer";
      open.onmessage = ({ data }) => heard(data, hooks);
      open.onclose = () => { hooks.closed(); setTimeout(dial, 1000); };
    };
    dial();
    return { send: (text) => open.readyState === WebSocket.OPEN && open.send(text) };
  };
}

// A notebook's widget (anywidget): one model may be shown by several pages, which tell whom they mean.
function kernel(model, page) {
  return (hooks) => {
    const hear = (content, buffers) => {
      if (content.page !== page) return;
      if (!buffers?.length) { hooks.told(JSON.parse(content.text)); return; }
      const { buffer, byteOffset, byteLength } = buffers[0];
      heard(buffer.slice(byteOffset, byteOffset + byteLength), hooks);
    };
    let known = JSON.stringify(model.get("settings"));
    const chosen = () => {
      const settings = model.get("settings"), text = JSON.stringify(settings);
      if (text !== known) hooks.told({ kind: "settings", settings: { ...settings } });
      known = text;
    };
    model.on("msg:custom", hear);
    model.on("change:settings", chosen);
    model.send({ page, kind: "opened" });
    return {
      send: (text) => model.send({ page, kind: "told", text }),
      settled: (settings) => {
        const text = JSON.stringify(settings);
        if (text === known) return;
        known = text;
        model.set("settings", JSON.parse(text));
        model.save_changes();
      },
      close: () => {
        model.off("msg:custom", hear);
        model.off("change:settings", chosen);
        model.send({ page, kind: "closed" });
      },
    };
  };
}

function render({ model, el }) {
  const style = made("style", {}, model.get("_style")), root = made("main");
  el.attachShadow({ mode: "open" }).append(style, root);
  return show(root, kernel(model, crypto.randomUUID()));
}

export default { render };

const main = document.getElementById("viewer");
if (main) {
  const token = new URLSearchParams(location.search).get("token");
  show(main, socket(`ws://${location.host}/socket?token=${encodeURIComponent(token)}`));
}
