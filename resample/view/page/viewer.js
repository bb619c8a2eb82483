// A picture that a command would paint, and its options. State is the options alone: what the page
// shows, exports and saves is made from them.

const STILL = 160; // ms after the last gesture, from which on the whole picture is asked for
const LARGEST = 1024; // px of a side that is asked for
const OPEN = ["Look", "Camera"]; // headings that begin unfolded
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

function spelled([azimuth, elevation, zoom, right, up]) {
  const parts = [azimuth, elevation, zoom];
  if (right || up) parts.push(right, up);
  return parts.map(rounded).join("/");
}

export function show(el, connect) {
  let about = null, settings = {}, number = 0, timer = 0, url = "", waiting = false, again = null;
  let shown = { width: 1, height: 1 };
  const fields = new Map();

  const image = made("img", { alt: "The picture", draggable: false });
  const message = made("div", { class: "message", role: "status", "aria-live": "polite" });
  const canvas = made("div", {
    class: "canvas", tabIndex: 0, role: "application",
    "aria-label": "Picture: arrows turn it, plus and minus zoom, shift and arrows move it",
  }, image, message);
  const badge = made("span", { class: "badge", id: "badge" }, "…");
  const picked = made("span", { class: "picked", id: "picked" });
  const views = made("select", { "aria-label": "View from", id: "views" },
    made("option", { value: "" }, "View from…"), ...VIEWS.map((v) => made("option", { value: v }, v)));
  const bar = made("div", { class: "bar" }, badge, views,
    made("button", { id: "export", onclick: () => say("export") }, "Export"),
    made("button", { id: "save-png", onclick: () => say("save", { suffix: ".png" }) }, "PNG"),
    made("button", { id: "save-exr", onclick: () => say("save", { suffix: ".exr" }) }, "EXR"),
    made("button", { id: "reset", onclick: () => replaced({ ...about.settings }) }, "Reset"), picked);
  const side = made("aside", { class: "side" });
  const dialog = made("dialog", { id: "exports" });
  el.append(made("div", { class: "stage" }, canvas, bar), side, dialog);

  const link = connect({ opened: () => wish(false), told, frame: framed, closed });

  function size() {
    const box = canvas.getBoundingClientRect();
    const most = LARGEST / Math.max(box.width, box.height, 1);
    const scale = Math.min(window.devicePixelRatio || 1, most);
    return {
      width: Math.max(8, Math.round(box.width * scale)),
      height: Math.max(8, Math.round(box.height * scale)),
    };
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
    say("draw", { moving });
  }

  function told(given) {
    if (given.kind === "about") begin(given);
    if (given.kind === "error") { waiting = false; note(given.text, "message"); }
    if (given.kind === "notice") note(given.text, "message notice");
    if (given.kind === "picked") {
      picked.textContent = Object.entries(given.found).map(([k, v]) => `${k} ${v}`).join(" · ") || "nothing here";
    }
    if (given.kind === "exported") exported(given.texts);
  }

  function begin(given) {
    about = given;
    if (about.gestures === "corners") {
      views.hidden = true;
      canvas.append(...handles);
      if (about.settings.corners === "") about.settings.corners = fitted();
    }
    replaced({ ...about.settings });
    build();
    placed();
  }

  function framed(head, bytes) {
    if (head.kind === "file") { download(head.name, bytes); return; }
    waiting = false;
    note("", "message");
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

  function exported(texts) {
    dialog.replaceChildren(
      ...Object.entries(texts).flatMap(([name, text]) => [
        made("strong", {}, name[0].toUpperCase() + name.slice(1)),
        made("button", { onclick: () => navigator.clipboard?.writeText(text) }, "Copy"),
        made("pre", { id: `export-${name}` }, text),
      ]),
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
    if (key === "window") histogram.draw();
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
    if (key === "transfer") {
      input.setAttribute("list", "transfers");
      input.after?.(made("datalist"));
    }
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
        "Drag over the histogram: the window that looks are spread over. Double-click: all of it.")] : []),
      made("datalist", { id: "transfers" }, ...(about.transfers ?? []).map((one) => made("option", { value: one }))),
      ...[...headings].map(([name, labels]) =>
        made("details", { open: OPEN.includes(name) || about.gestures === "corners" }, made("summary", {}, name), ...labels)),
    );
    histogram.draw();
  }

  // Histogram, over which the window is dragged

  const histogram = (() => {
    const element = made("canvas", { class: "histogram", id: "histogram", tabIndex: 0,
      "aria-label": "Histogram: drag to choose a window, arrows move it" });
    let from = null;
    const span = () => about.histogram.high - about.histogram.low || 1;
    const valueAt = (event) => {
      const box = element.getBoundingClientRect();
      const share = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
      return about.histogram.low + share * span();
    };
    const ends = () => {
      const parts = String(settings.window ?? "").split("/").map(Number);
      if (parts.length !== 2 || parts.some(Number.isNaN)) return null;
      return [parts[0] - parts[1] / 2, parts[0] + parts[1] / 2];
    };
    const put = (a, b, moving) => {
      const low = Math.min(a, b), width = Math.abs(b - a);
      if (width > span() / 500) changed("window", `${rounded(low + width / 2)}/${rounded(width)}`, moving);
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
        const value = low + ((n + 0.5) / counts.length) * span();
        const inside = !range || (value >= range[0] && value <= range[1]);
        pen.fillStyle = style.getPropertyValue(inside ? "--accent" : "--line");
        const tall = (Math.log1p(count) / most) * element.height;
        pen.fillRect(n * step, element.height - tall, Math.max(1, step), tall);
      });
    };
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      from = valueAt(event);
    });
    element.addEventListener("pointermove", (event) => from !== null && put(from, valueAt(event), true));
    element.addEventListener("pointerup", (event) => {
      if (from !== null) put(from, valueAt(event), false);
      from = null;
    });
    element.addEventListener("dblclick", () => changed("window", undefined));
    element.addEventListener("keydown", (event) => {
      const range = ends() ?? [about.histogram.low, about.histogram.high];
      const by = { ArrowLeft: -span() / 50, ArrowRight: span() / 50 }[event.key];
      if (by === undefined) return;
      event.preventDefault();
      if (event.shiftKey) put(range[0] - by, range[1] + by, true);
      else put(range[0] + by, range[1] + by, true);
    });
    return { element, draw };
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

  function turned(dx, dy) {
    if (about.gestures === "corners") { panned(dx, dy); return; }
    steered((c) => {
      c[0] -= dx * 0.5;
      c[1] = Math.min(90, Math.max(-90, c[1] + dy * 0.5));
    });
  }

  function panned(dx, dy) {
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
    if (about.gestures === "corners") {
      const points = corners(), { width, height } = size();
      const around = ([x, y]) => [width / 2 + factor * (x - width / 2), height / 2 + factor * (y - height / 2)];
      if (points) put(points.map(around), true);
      return;
    }
    steered((c) => { c[2] = Math.min(1e3, Math.max(1e-3, c[2] * factor)); });
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
    const box = canvas.getBoundingClientRect(), { width, height } = size();
    say("pick", {
      x: ((event.clientX - box.left) / box.width) * width,
      y: ((event.clientY - box.top) / box.height) * height,
    });
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
    else if (event.key === "Home") changed("camera", "30/20/1");
    else return;
    event.preventDefault();
  });
  views.addEventListener("change", () => {
    if (views.value) changed("camera", views.value);
    views.value = "";
  });
  let width = 0;
  new ResizeObserver(() => {
    const now = size().width, points = corners();
    if (about?.gestures === "corners" && points && width && now !== width) {
      put(points.map((one) => one.map((part) => (part * now) / width)), true);
    }
    width = now;
    histogram.draw();
    placed();
    wish(true);
  }).observe(canvas);
}

// A socket that opens itself again; `hooks` are told what comes through it.
export function socket(address) {
  return (hooks) => {
    let open = null;
    const dial = () => {
      open = new WebSocket(address);
      open.binaryType = "arraybuffer";
      open.onmessage = ({ data }) => {
        if (typeof data === "string") { hooks.told(JSON.parse(data)); return; }
        const length = new DataView(data).getUint32(0, true);
        const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
        hooks.frame(head, new Uint8Array(data, 4 + length));
      };
      open.onclose = () => { hooks.closed(); setTimeout(dial, 1000); };
    };
    dial();
    return { send: (text) => open.readyState === WebSocket.OPEN && open.send(text) };
  };
}

const main = document.getElementById("viewer");
if (main) {
  const token = new URLSearchParams(location.search).get("token");
  show(main, socket(`ws://${location.host}/socket?token=${encodeURIComponent(token)}`));
}
