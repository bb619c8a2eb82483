// A camera around a volume or a cloud: what gestures do is written into `camera`.

import { between, rounded } from "./elements.js";

export const VIEWS = ["front", "back", "left", "right", "top", "bottom", "corner"];
const NAMED = {
  front: [0, 0], back: [180, 0], right: [90, 0], left: [-90, 0], top: [0, 90], bottom: [0, -90],
  corner: [45, 35.264389682754654],
};
export const BEGIN = "30/20/1";

// azimuth/elevation/zoom/right/up as numbers, and back as text.
function cameraOf(text) {
  if (text in NAMED) return [...NAMED[text], 1, 0, 0];
  const parts = String(text).split("/").map(Number);
  if (parts.some(Number.isNaN) || parts.length < 2) return null;
  return [parts[0], parts[1], parts[2] ?? 1, parts[3] ?? 0, parts[4] ?? 0];
}

function spelledCamera([azimuth, elevation, zoom, right, up]) {
  const parts = [azimuth, elevation, zoom];
  if (right || up) parts.push(right, up);
  return parts.map(rounded).join("/");
}

export function orbit(page) {
  function steered(change) {
    const camera = cameraOf(page.settings.camera ?? BEGIN);
    if (!camera) { page.note("The camera is a file; choose a view first.", "message"); return; }
    change(camera);
    page.changed("camera", spelledCamera(camera), true);
  }

  return {
    hint: "arrows turn it, plus and minus zoom, shift and arrows move it",
    frame: () => page.canvas.getBoundingClientRect(),
    turned: (dx, dy) => steered((c) => {
      c[0] -= dx * 0.5;
      c[1] = between(-90, c[1] + dy * 0.5, 90);
    }),
    panned: (dx, dy) => {
      const box = page.canvas.getBoundingClientRect(), side = Math.min(box.width, box.height);
      steered((c) => { c[3] += dx / side; c[4] -= dy / side; });
    },
    zoomed: (factor) => steered((c) => { c[2] = between(1e-3, c[2] * factor, 1e3); }),
    home: () => page.changed("camera", BEGIN),
  };
}
