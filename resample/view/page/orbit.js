// A camera around a volume or a cloud: what gestures do is written into `camera`.

import { between, rounded } from "./elements.js";

export const VIEWS = ["front", "back", "left", "right", "top", "bottom", "corner"];
const NAMED = {
  front: [0, 0], back: [180, 0], right: [90, 0], left: [-90, 0], top: [0, 90], bottom: [0, -90],
  corner: [45, 35.264389682754654],
};
export const BEGIN = "30,20,1";
const FULL = 0.94; // share of the picture that an object takes which fills it

// azimuth,elevation,zoom,right,up as numbers, and back as text.
function cameraOf(text) {
  if (text in NAMED) return [...NAMED[text], 1, 0, 0];
  const parts = String(text).split(/[,/]/).map(Number);
  if (parts.some(Number.isNaN) || parts.length < 2) return null;
  return [parts[0], parts[1], parts[2] ?? 1, parts[3] ?? 0, parts[4] ?? 0];
}

function spelledCamera([azimuth, elevation, zoom, right, up]) {
  const parts = [azimuth, elevation, zoom];
  if (right || up) parts.push(right, up);
  return parts.map(rounded).join(",");
}

export function orbit(page) {
  function steered(change) {
    const camera = cameraOf(page.settings.camera ?? BEGIN);
    if (!camera) { page.note("The camera is read from a file; choose a view first.", "message"); return; }
    change(camera);
    page.changed("camera", spelledCamera(camera), true);
  }

  return {
    help: [
      ["drag, arrows", "rotate"],
      ["Shift or right button and drag, Shift and arrows", "pan"],
      ["wheel, two fingers, + and -", "zoom to the pointer"],
      ["0, Home", "fit it into the window; back to the first view"],
    ],
    hint: "arrows rotate, plus and minus zoom, shift and arrows pan",
    frame: () => page.canvas.getBoundingClientRect(),
    turned: (dx, dy) => steered((c) => {
      c[0] -= dx * 0.5;
      c[1] = between(-90, c[1] + dy * 0.5, 90);
    }),
    // The camera comes nearer, and what fills a part of the picture is in its middle. Whether that was so.
    filled: (box, isFirst) => {
      const { width, height } = page.size(), side = Math.min(width, height);
      const cuts = [box.left, box.top, 1 - box.right, 1 - box.bottom].filter((gap) => gap <= 0.002).length, isCut = cuts > 0;
      const taken = Math.max(box.right - box.left, box.bottom - box.top);
      const [right, down] = [(box.left + box.right - 1) / 2, (box.top + box.bottom - 1) / 2];
      if (taken > FULL - 0.06 && taken <= FULL + 0.02 && !isCut && Math.max(Math.abs(right), Math.abs(down)) < 0.01) return true;
      const camera = cameraOf(page.settings.camera ?? BEGIN), factor = isCut ? 0.8 : FULL / taken;
      if (!camera || (isFirst && cuts > 2 && page.about.fills !== "outside")) return true; // it is all around
      camera[2] = between(1e-3, camera[2] * factor, 1e3);
      camera[3] = factor * (camera[3] - (right * width) / side);
      camera[4] = factor * (camera[4] + (down * height) / side);
      page.put("camera", spelledCamera(camera.map((one) => Number(one.toPrecision(4)))));
      return false;
    },
    panned: (dx, dy) => {
      const box = page.canvas.getBoundingClientRect(), side = Math.min(box.width, box.height);
      steered((c) => { c[3] += dx / side; c[4] -= dy / side; });
    },
    // What is under a place of the page stays there, if it is as far as the middle.
    zoomed: (factor, at) => {
      const box = page.canvas.getBoundingClientRect(), side = Math.min(box.width, box.height);
      const [right, down] = at ? [(at.x - box.left - box.width / 2) / side, (at.y - box.top - box.height / 2) / side] : [0, 0];
      steered((c) => {
        const before = c[2];
        c[2] = between(1e-3, c[2] * factor, 1e3);
        if (!at) return;
        c[3] = right - (c[2] / before) * (right - c[3]);
        c[4] = -down + (c[2] / before) * (down + c[4]);
      });
    },
    home: () => page.changed("camera", page.about.settings.camera ?? BEGIN),
  };
}
