// A field for each option, under the heading that it has in the command's help.

import { made } from "./elements.js";
import { lens } from "./lens.js";
import { lights } from "./light.js";
import { rangeOf, slider } from "./sliders.js";

const OPEN = ["Look", "Camera", "Light", "Picture"]; // headings that begin unfolded

const BELOW = { lens, light: lights }; // sliders below the texts of options

const isBelow = ({ key, schema }) => key in BELOW && ![schema, ...(schema.anyOf ?? [])].some((one) => one.enum);

// The input of an option, and what is read from it: undefined where nothing was given.
function inputOf({ schema, default: usual }) {
  const types = [schema, ...(schema.anyOf ?? [])];
  const choices = types.map((one) => one.enum).find(Boolean);
  const kind = types.map((one) => one.type).find((one) => one && one !== "null");
  if (choices) {
    const open = types.some((one) => one.type === "null");
    const input = made("select", {}, ...(open ? [made("option", { value: "" }, "—")] : []),
      ...choices.map((one) => made("option", { value: String(one) }, String(one))));
    return [input, () => (input.value === "" ? undefined : input.value)];
  }
  if (kind === "boolean") {
    const input = made("input", { type: "checkbox" });
    return [input, () => (input.checked === Boolean(usual) ? undefined : input.checked)];
  }
  if (kind === "number" || kind === "integer") {
    const input = made("input", { type: "number", step: kind === "integer" ? "1" : "any" });
    return [input, () => (input.value === "" ? undefined : Number(input.value))];
  }
  if (kind === "array") {
    const input = made("input", { type: "text", placeholder: "several: a; b" });
    return [input, () => input.value.split(";").map((one) => one.trim()).filter(Boolean)];
  }
  const input = made("input", { type: "text", placeholder: String(usual ?? "") });
  return [input, () => input.value];
}

export function fields(page) {
  const known = new Map();

  function field(control) {
    const { key, help } = control, [input, read] = inputOf(control);
    const names = page.about.names?.[key] ?? [];
    const list = made("datalist", { id: `names-${key}` }, ...names.map((one) => made("option", { value: one })));
    if (names.length) input.setAttribute("list", list.id);
    input.id = `option-${key}`;
    input.addEventListener("change", () => {
      const value = read();
      const usual = Array.isArray(value) ? value.length === 0 : value === control.default;
      page.changed(key, usual ? undefined : value);
    });
    const how = rangeOf(control, page.about), range = how && made("input", { id: `range-${key}`, "aria-label": key });
    const held = how && slider(how, range, input, (value, moving) => page.changed(key, value === control.default ? undefined : value, moving));
    const label = made("label", { title: help, class: how ? "ranged" : "" }, made("span", {}, key), ...(how ? [range] : []), input, ...(names.length ? [list] : []));
    const put = (value) => {
      label.classList.toggle("changed", value !== undefined);
      const now = value ?? control.default ?? "";
      if (input.type === "checkbox") input.checked = Boolean(now);
      else input.value = Array.isArray(now) ? now.join("; ") : String(now);
      input.dataset.shown = input.value;
      held?.put(now === "" ? undefined : Number(now));
    };
    known.set(key, put);
    put(page.settings[key]);
    return [label];
  }

  // Texts of a lens and of a light have sliders below.
  function withSliders(key, [label]) {
    const { element, shown } = BELOW[key](page), put = known.get(key);
    known.set(key, (value) => { put(value); shown(); });
    return [label, element];
  }

  // Elements of all options.
  function build() {
    known.clear();
    const headings = new Map();
    for (const control of page.about.controls) {
      if (!headings.has(control.heading)) headings.set(control.heading, []);
      const parts = field(control);
      headings.get(control.heading).push(...(isBelow(control) ? withSliders(control.key, parts) : parts));
    }
    return [...headings].map(([name, labels]) =>
      made("details", { open: OPEN.includes(name) || Boolean(page.steering.unfolds) }, made("summary", {}, name), ...labels));
  }

  return {
    build,
    put: (key) => known.get(key)?.(page.settings[key]),
    putAll: () => { for (const [key, put] of known) put(page.settings[key]); },
  };
}
