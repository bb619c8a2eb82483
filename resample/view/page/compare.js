// A picture compared with the one that is shown, seen from the same camera: one that is kept, that of
// the options at the start or of another method, or a rival's. A divider slides over both, or they
// stand side by side with their difference.

import { between, hung, made } from "./elements.js";

// Options that compared pictures share
const LINKED = ["camera", "fov", "up", "fit", "corners", "move", "turn", "pose", "target-fov", "steady"];
const START = "start", METHOD = "method=";

export function compare(page) {
  let kept = null, chosen = ""; // settings, or what is chosen in the list; neither: nothing is compared
  let at = 0.5; // of the picture's width, where the divider is
  const other = pane("other"), apart = pane("difference");
  const button = made("button", { id: "compare", "aria-pressed": "false",
    title: "Keep this picture, and compare the next ones with it", onclick: () => begun(kept ? null : { ...page.settings }, "") }, "Keep");
  const rivals = made("select", { id: "rivals", hidden: true, "aria-label": "Compare with" });
  const slides = made("button", { id: "slides", "aria-pressed": "false", hidden: true,
    title: "Slide a divider over both pictures instead of showing them side by side", onclick: () => slid(!isSlid()) }, "Divider");
  const over = made("img", { class: "compared", id: "compared", hidden: true, alt: "The picture it is compared with", draggable: false });
  const divider = made("div", { class: "divider", id: "divider", role: "slider", tabIndex: 0, hidden: true,
    "aria-label": "Divider: the compared picture is left of it", "aria-valuemin": "0", "aria-valuemax": "100" });
  const [left, right] = ["left", "right"].map((side) => made("div", { class: `side-name ${side}`, hidden: true }));
  const isOn = () => Boolean(kept || chosen), isSlid = () => slides.getAttribute("aria-pressed") === "true";
  rivals.addEventListener("change", () => begun(null, rivals.value));

  function pane(name) {
    const image = made("img", { alt: name, draggable: false }), caption = made("div", { class: "caption" });
    return { element: made("figure", { class: "pane", id: name }, image, caption), image, caption };
  }

  // What can be compared with; rivals that are not installed say why.
  function offer({ controls, names, rivals: given }) {
    const control = controls.find((one) => one.key === "method"), types = control ? [control.schema, ...(control.schema.anyOf ?? [])] : [];
    const methods = types.map((one) => one.enum).find(Boolean) ?? names?.method ?? [];
    rivals.hidden = false;
    rivals.replaceChildren(made("option", { value: "" }, "Compare…"), made("option", { value: START }, "the first options"),
      ...methods.map((name) => made("option", { value: METHOD + name }, `method ${name}`)),
      ...Object.entries(given ?? {}).map(([name, absence]) =>
        made("option", { value: name, disabled: Boolean(absence), title: absence }, absence ? `${name} (not installed)` : name)));
  }

  function begun(given, name) {
    kept = given;
    chosen = name;
    rivals.value = name;
    button.setAttribute("aria-pressed", String(Boolean(kept)));
    slides.hidden = !isOn();
    if (!isOn()) slid(false);
    arranged();
    page.wish(false);
  }

  function slid(on) {
    slides.setAttribute("aria-pressed", String(on));
    arranged();
  }

  function arranged() {
    const beside = isOn() && !isSlid();
    if (beside) page.panes.append(other.element, apart.element);
    else { other.element.remove(); apart.element.remove(); }
    page.panes.classList.toggle("several", beside);
    for (const one of [over, divider, left, right]) one.hidden = !isOn() || beside;
    if (!over.getAttribute("src")) over.hidden = true;
    placed();
  }

  // Divider
  function placed() {
    const share = `${(100 * at).toFixed(2)}%`;
    over.style.clipPath = `inset(0 calc(100% - ${share}) 0 0)`;
    divider.style.left = share;
    divider.setAttribute("aria-valuenow", String(Math.round(100 * at)));
  }

  function moved(share) {
    at = between(0.01, share, 0.99);
    placed();
  }

  divider.addEventListener("pointerdown", (event) => {
    event.stopPropagation();
    divider.setPointerCapture(event.pointerId);
  });
  divider.addEventListener("pointermove", (event) => {
    if (!divider.hasPointerCapture(event.pointerId)) return;
    const box = page.canvas.getBoundingClientRect();
    moved((event.clientX - box.left) / box.width);
  });
  divider.addEventListener("pointerup", (event) => event.stopPropagation());
  divider.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 }[event.key];
    if (!by) return;
    event.preventDefault();
    event.stopPropagation();
    moved(at + by);
  });

  // What a wish for a picture says besides. Rivals paint when nothing moves, as they are slow.
  function wished(moving) {
    const isRival = chosen && chosen !== START && !chosen.startsWith(METHOD);
    for (const one of [other.element, apart.element, over]) one.classList.toggle("stale", Boolean(isRival && moving));
    if (isRival) return moving ? {} : { rival: chosen };
    if (!isOn()) return {};
    if (chosen.startsWith(METHOD)) return { other: { ...page.settings, method: chosen.slice(METHOD.length) } };
    const given = { ...(kept ?? page.about.settings) };
    for (const key of LINKED) {
      if (key in page.settings) given[key] = page.settings[key]; else delete given[key];
    }
    return { other: given };
  }

  // What was changed since, as a caption has room for it.
  function differing() {
    const keys = [...new Set([...Object.keys(page.settings), ...Object.keys(kept)])];
    const found = keys.filter((key) => !LINKED.includes(key) && String(page.settings[key]) !== String(kept[key]));
    return found.map((key) => `${key} ${kept[key] ?? "default"}`.slice(0, 40)).join(", ");
  }

  function named(milliseconds) {
    const name = kept ? `kept${differing() ? `: ${differing()}` : ""}` : rivals.selectedOptions[0].textContent;
    return kept ? name : `${name} · ${Math.round(milliseconds)} ms`;
  }

  function framed(head, bytes) {
    if (!isOn()) return;
    if (head.kind === "other") {
      hung(over, bytes.slice(), head.type);
      left.textContent = named(head.milliseconds);
      right.textContent = "shown";
      arranged();
    }
    const where = head.kind === "other" ? other : apart;
    hung(where.image, bytes, head.type);
    const decibels = head.decibels === null ? "equal" : `${head.decibels} dB`;
    where.caption.textContent = head.kind === "other"
      ? named(head.milliseconds) : `difference × ${head.gain} · ${decibels}`;
    if (head.kind === "difference") right.textContent = `shown · ${decibels}`;
  }

  // Why there is no picture to compare with.
  function failed(text) {
    for (const one of [other.image, apart.image, over]) one.removeAttribute("src");
    other.caption.textContent = left.textContent = text;
    apart.caption.textContent = "";
    arranged();
  }

  page.canvas.append(over, divider, left, right);
  return { buttons: [button, rivals, slides], offer, wished, framed, failed };
}
