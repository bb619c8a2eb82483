// Places that were picked: lines between them with their lengths, and the values along the last line.

import { drawnTicks, short, ticks } from "./axis.js";
import { made, svg } from "./elements.js";

const SPACE = 22, ASIDE = 46; // px of a chart under and left of the values, for numbers

export function measure(page) {
  const button = made("button", { id: "measure", "aria-pressed": "false", hidden: true, title: "Click two points: their distance, and the values along the line", onclick: () => turned(!isOn()) }, "Measure");
  const lines = svg("svg", { class: "lines measured" });
  const chart = made("canvas", { id: "profile", "aria-label": "Values along the line" }), said = made("div", { class: "under", id: "profile-said", role: "status" });
  const panel = made("div", { class: "profile", hidden: true }, said, chart);
  let places = []; // around the middle, scene units; at most three
  let found = null; // length, unit and values of the last line
  const isOn = () => button.getAttribute("aria-pressed") === "true";
  const middle = () => page.about.box?.middle ?? [0, 0, 0];
  const apart = (a, b) => Math.hypot(...a.map((one, n) => one - b[n]));
  const length = (number) => `${Number(number.toPrecision(4))} ${page.about.unit ?? ""}`.trim();

  function turned(on) {
    button.setAttribute("aria-pressed", String(on));
    if (on) { said.textContent = places.length > 1 ? "" : "click two places"; asked(); } else places = [];
    found = on ? found : null;
    shown();
  }

  // A place was picked; null: nothing was there, and lines begin anew.
  function marked(place) {
    places = place ? [...places.slice(isOn() ? -1 : -2), place] : [];
    if (!place) found = null;
    asked();
    shown();
  }

  function asked() {
    if (!isOn() || places.length < 2) return;
    if (!page.about.slices) { said.textContent = `${length(apart(...places.slice(-2)))} long`; return; }
    const [start, end] = places.slice(-2).map((one) => one.map((part, n) => part + middle()[n]));
    page.say("measure", { start, end });
  }

  function told(given) {
    found = given;
    shown();
  }

  function shown() {
    panel.hidden = !isOn();
    drawn();
    placed();
    page.linesMoved();
  }

  // Lines over the picture, with their lengths in the middle of each
  function placed() {
    const at = places.map((one) => page.projected(one)?.at);
    lines.replaceChildren(...at.flatMap((here, n) => {
      if (!here) return [];
      const parts = [svg("circle", { cx: here[0], cy: here[1], r: 3 })], before = at[n - 1];
      if (!before) return parts;
      const text = svg("text", { x: (here[0] + before[0]) / 2 + 6, y: (here[1] + before[1]) / 2 - 6 });
      text.append(length(apart(places[n], places[n - 1])));
      return [...parts, svg("line", { x1: before[0], y1: before[1], x2: here[0], y2: here[1] }), text];
    }));
  }

  // The chart

  const known = () => (found?.values ?? []).filter((one) => one !== null);

  function drawn() {
    chart.hidden = known().length === 0;
    if (panel.hidden || chart.hidden) return;
    const ratio = window.devicePixelRatio || 1, box = chart.getBoundingClientRect(), style = getComputedStyle(page.el);
    chart.width = Math.max(1, box.width * ratio);
    chart.height = Math.max(1, box.height * ratio);
    const pen = chart.getContext("2d"), left = ASIDE * ratio, base = chart.height - SPACE * ratio, top = 6 * ratio;
    const least = Math.min(...known()), most = Math.max(...known(), least + 1e-12 + Math.abs(least) * 1e-6);
    const x = (share) => left + share * (chart.width - left - 8 * ratio), y = (value) => base - ((value - least) / (most - least)) * (base - top);
    const values = ticks(0, found.distance);
    drawnTicks(pen, { values, to: (one) => x(one / found.distance), baseline: base, width: chart.width, ratio, color: style.getPropertyValue("--faint") });
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const one of ticks(least, most, 4)) {
      pen.fillStyle = style.getPropertyValue("--faint");
      pen.fillText(short(one), left - 5 * ratio, y(one));
      pen.fillStyle = style.getPropertyValue("--line");
      pen.fillRect(left, y(one), chart.width - left - 8 * ratio, ratio / 2);
    }
    pen.strokeStyle = style.getPropertyValue("--accent");
    pen.lineWidth = 1.5 * ratio;
    pen.beginPath();
    let isPen = false;
    found.values.forEach((value, n) => {
      const at = [x(n / (found.values.length - 1)), y(value ?? 0)];
      if (value !== null) { if (isPen) pen.lineTo(...at); else pen.moveTo(...at); }
      isPen = value !== null;
    });
    pen.stroke();
    saidAt(null);
  }

  // In words: the whole line, or what is under the pointer
  function saidAt(share) {
    const unit = found.unit ? ` ${found.unit}` : "", all = known();
    if (share === null) { said.textContent = `${Number(found.distance.toPrecision(6))}${unit} long · values ${short(Math.min(...all))} to ${short(Math.max(...all))}`; return; }
    const value = found.values[Math.round(share * (found.values.length - 1))];
    said.textContent = `at ${short(share * found.distance)}${unit} · value ${value === null ? "missing" : short(value)}`;
  }

  chart.addEventListener("pointermove", (event) => {
    const box = chart.getBoundingClientRect(), share = (event.clientX - box.left - ASIDE) / (box.width - ASIDE - 8);
    if (found) saidAt(share >= 0 && share <= 1 ? share : null);
  });
  chart.addEventListener("pointerleave", () => { if (found) saidAt(null); });

  function begin(stage) {
    button.hidden = !page.about.measures;
    page.canvas.append(lines);
    stage.append(panel);
  }

  function reset() {
    places = [];
    found = null;
    if (isOn()) turned(false); else shown();
  }

  return { button, begin, marked, told, placed, drawn, reset, isOn, places: () => places };
}
