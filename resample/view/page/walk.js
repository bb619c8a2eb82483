// A camera near a picture with depth: what gestures do is written into `move`, steps to the right,
// down and ahead in scene units, and `turn`, degrees to the right and up.

import { rounded } from "./elements.js";

export function walk(page) {
  // What of the canvas the picture fills: what has the sides of a camera's picture.
  function frame() {
    const box = page.canvas.getBoundingClientRect();
    const [across, down] = page.about.extent, scale = Math.min(box.width / across, box.height / down);
    const width = scale * across, height = scale * down;
    return { left: box.left + (box.width - width) / 2, top: box.top + (box.height - height) / 2, width, height };
  }

  // Steps to the right and down, for each ahead, to a place of the page; of other cameras: 0
  function toward(at) {
    const { focal, extent } = page.about, box = frame();
    const isOther = Object.keys(page.settings).some((key) => key.startsWith("target-") || key === "lens");
    if (!at || !focal?.length || isOther) return [0, 0];
    const per = extent[0] / box.width;
    return [((at.x - box.left) * per - focal[2]) / focal[0], ((at.y - box.top) * per - focal[3]) / focal[1]];
  }

  function walked(change) {
    const [move, turn] = ["move", "turn"].map((key) => {
      const parts = String(page.settings[key] ?? "").split(",").map(Number);
      return parts.length === 3 && parts.every(Number.isFinite) ? parts : [0, 0, 0];
    });
    change(move, turn);
    page.put("turn", turn.some(Boolean) ? turn.map(rounded).join(",") : undefined);
    page.changed("move", move.map(rounded).join(","), true);
  }

  return {
    help: [
      ["drag, arrows", "move the camera around a point at middle distance"],
      ["Shift or right button and drag, Shift and arrows", "turn the camera"],
      ["wheel, two fingers, + and -", "move forward and back"],
      ["Home", "back to where the picture was taken"],
    ],
    hint: "arrows move the camera, shift and arrows turn it, plus and minus move forward and back",
    frame,
    keyframe: () => ["move", "turn"].map((key) => page.settings[key] ?? "0,0,0").join(";"),
    // Steps aside; what is in the middle distance stays where it is.
    turned: (dx, dy) => {
      const [near, middle] = page.about.distance, per = (0.6 * near) / frame().width;
      walked((move, turn) => {
        move[0] -= dx * per;
        move[1] -= dy * per;
        turn[0] += (Math.atan(dx * per / middle) * 180) / Math.PI;
        turn[1] -= (Math.atan(dy * per / middle) * 180) / Math.PI;
      });
    },
    panned: (dx, dy) => {
      const per = 40 / frame().width; // degrees
      walked((move, turn) => {
        turn[0] -= dx * per;
        turn[1] += dy * per;
      });
    },
    // Ahead, toward what is under a place of the page: that stays there.
    zoomed: (factor, at) => {
      const far = Math.log(factor) * page.about.distance[0] * 0.5, [x, y] = toward(at);
      walked((move, [yaw, pitch]) => {
        const [a, b] = [yaw, pitch].map((one) => (one * Math.PI) / 180);
        const down = y * Math.cos(b) - Math.sin(b), ahead = y * Math.sin(b) + Math.cos(b);
        move[0] += far * (x * Math.cos(a) + ahead * Math.sin(a));
        move[1] += far * down;
        move[2] += far * (ahead * Math.cos(a) - x * Math.sin(a));
      });
    },
    home: () => walked((move, turn) => { move.fill(0); turn.fill(0); }),
  };
}
