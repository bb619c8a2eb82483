// Where light comes from by two angles, as the camera's: sliders that write the text of `light`.

import { made, rounded } from "./elements.js";
import { row } from "./sliders.js";

const DEGREE = Math.PI / 180;

// Unit vectors up, to the right and toward a camera at azimuth 0
function axesOf(up) {
  const axis = ["x", "y", "z"].indexOf(String(up).slice(-1)), sign = String(up).startsWith("-") ? -1 : 1;
  const along = (n, length) => [0, 1, 2].map((one) => (one === n % 3 ? length : 0));
  return [along(axis, sign), along(axis + 1, 1), along(axis + 2, -sign)];
}

export function lights(page) {
  const azimuth = row({ id: "light-azimuth", name: "azimuth", low: -180, high: 180, usual: 0, title: "Degrees around, like the camera's" }, (value, moving) => put({ azimuth: value }, moving));
  const elevation = row({ id: "light-elevation", name: "elevation", low: -90, high: 90, usual: 0, title: "Degrees up, like the camera's" }, (value, moving) => put({ elevation: value }, moving));
  const element = made("div", { class: "indented" }, azimuth.element, elevation.element);
  const axes = () => axesOf(page.settings.up ?? "z");

  // Angles of the light; at the eye: of the camera
  function angles() {
    const toward = String(page.settings.light ?? "").split(/[,/]/).map(Number);
    if (toward.length !== 3 || !toward.every(Number.isFinite)) {
      const [a, e] = String(page.settings.camera ?? "").split(/[,/]/).map(Number);
      return Number.isFinite(a + e) ? { azimuth: ((a + 180) % 360 + 360) % 360 - 180, elevation: e } : { azimuth: 0, elevation: 0 };
    }
    const [up, aside, front] = axes().map((axis) => axis.reduce((sum, one, n) => sum + one * toward[n], 0));
    return { azimuth: Math.atan2(aside, front) / DEGREE, elevation: Math.atan2(up, Math.hypot(aside, front)) / DEGREE };
  }

  function put(change, moving) {
    const { azimuth: a, elevation: e } = { ...angles(), ...change };
    const [up, aside, front] = axes(), level = Math.cos(e * DEGREE);
    const toward = up.map((one, n) => Math.sin(e * DEGREE) * one
      + level * (Math.sin(a * DEGREE) * aside[n] + Math.cos(a * DEGREE) * front[n]));
    page.changed("light", toward.map((one) => rounded(Number(one.toFixed(5)) || 0)).join(","), moving);
  }

  function shown() {
    const now = angles();
    azimuth.put(Number(now.azimuth.toFixed(1)));
    elevation.put(Number(now.elevation.toFixed(1)));
  }

  shown();
  return { element, shown };
}
