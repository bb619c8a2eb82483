// Numbers of a chart: round values along it, and texts of them.

import { rounded } from "./elements.js";

// Up to `most` round values from low to high, evenly apart.
export function ticks(low, high, most = 6) {
  const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
  if (!(raw > 0) || !Number.isFinite(power)) return [];
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= raw * 0.999);
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, n) => (first + n) * step);
}

export function short(number) {
  const size = Math.abs(number);
  if (size >= 1e6 || (size > 0 && size < 1e-3)) return number.toExponential(1).replace("e+", "e");
  return rounded(Number(number.toPrecision(5)));
}

// Draw ticks with numbers under a chart: `to` gives px of a value.
export function drawnTicks(pen, { values, to, baseline, width, ratio, color, texts = values.map(short) }) {
  pen.fillStyle = color;
  pen.font = `${11 * ratio}px system-ui, sans-serif`;
  pen.textBaseline = "top";
  pen.textAlign = "left";
  let end = -Infinity;
  values.forEach((value, n) => {
    const x = to(value), wide = pen.measureText(texts[n]).width, left = Math.min(Math.max(0, x - wide / 2), width - wide);
    pen.fillRect(Math.min(x, width - ratio), baseline, ratio, 3 * ratio);
    if (left < end + 6 * ratio) return;
    pen.fillText(texts[n], left, baseline + 4 * ratio);
    end = left + wide;
  });
}
