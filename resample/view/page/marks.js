// Axes and a scale bar. Volumes have options for both, which the exported command draws as well;
// over other pictures the page draws them.

import { short } from "./axis.js";
import { made, svg } from "./elements.js";

const OPTIONS = ["axes", "scale-bar"];
const ARM = 34, FROM_SIDE = 52; // px: length of an axis, and from the sides to where axes meet
const WIDEST = 0.25; // of the picture's width, of a scale bar

export function marks(page) {
  const button = made("button", { id: "scales", "aria-pressed": "false", hidden: true,
    title: "Axes and scale bar (s)", onclick: turned }, "Scales");
  const lines = svg("svg", { class: "lines scales" });
  let view = null;
  const isOption = () => OPTIONS.every((key) => page.about.controls.some((one) => one.key === key));
  const isOn = () => (isOption() ? OPTIONS.every((key) => page.settings[key]) : button.getAttribute("aria-pressed") === "true");

  function turned() {
    if (button.hidden) return;
    const on = !isOn();
    button.setAttribute("aria-pressed", String(on));
    if (isOption()) {
      for (const key of OPTIONS) page.put(key, on || undefined);
      page.wish(false);
    }
    drawn();
  }

  function text(x, y, words, anchor = "middle") {
    const element = svg("text", { x, y, "text-anchor": anchor });
    element.append(words);
    return element;
  }

  // Where x, y and z of the scene point to; those toward the eye last, over the others
  function axes(height) {
    const order = [0, 1, 2].sort((a, b) => view.rotation[2][b] - view.rotation[2][a]);
    return order.flatMap((axis) => {
      const [right, down] = [0, 1].map((row) => view.rotation[row][axis]);
      const [x, y] = [FROM_SIDE + ARM * right, height - FROM_SIDE + ARM * down];
      return [svg("line", { class: `axis-${axis}`, x1: FROM_SIDE, y1: height - FROM_SIDE, x2: x, y2: y }),
        text(FROM_SIDE + 1.3 * ARM * right, height - FROM_SIDE + 1.3 * ARM * down + 4, "xyz"[axis])];
    });
  }

  // A round length as it appears in the middle of the scene
  function scale(width, height) {
    const middle = page.about.middle ?? [0, 0, 0];
    const ahead = view.rotation[2].reduce((sum, one, n) => sum + one * middle[n], view.translation[2]);
    const depth = view.perspective ? ahead : 1, per = (view.focal[0] * width) / view.size[0] / depth;
    if (!(per > 0)) return [];
    const most = (WIDEST * width) / per, power = 10 ** Math.floor(Math.log10(most));
    const length = power * [5, 2, 1].find((one) => one * power <= most), long = length * per, left = (width - long) / 2;
    const d = `M${left} ${height - 24}v6h${long}v-6`;
    return [svg("path", { class: "halo", d }), svg("path", { d }),
      text(width / 2, height - 26, `${short(length)} ${page.about.unit ?? ""}`.trim())];
  }

  function drawn() {
    if (!page.about) return;
    if (isOption()) button.setAttribute("aria-pressed", String(Boolean(isOn())));
    const is = isOn() && !isOption() && view, { width, height } = page.canvas.getBoundingClientRect();
    lines.replaceChildren(...(is ? [...axes(height), ...scale(width, height)] : []));
  }

  function shown(given) {
    view = given ?? null;
    drawn();
  }

  page.canvas.append(lines);
  return { button, shown, drawn, turned, begin: () => { button.hidden = (page.about.gestures ?? "orbit") !== "orbit"; } };
}
