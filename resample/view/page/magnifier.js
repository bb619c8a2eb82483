// Pixels under the pointer, enlarged, and their levels.

import { between, made } from "./elements.js";

const GLASS = 21, LARGER = 8; // px that are shown, and how much larger

export function magnifier(page) {
  const { canvas, image, picked } = page;
  const glass = made("canvas", { class: "glass", id: "glass", width: GLASS * LARGER, height: GLASS * LARGER, hidden: true });
  const button = made("button", { id: "magnify", "aria-pressed": "false",
    title: "Enlarge the pixels under the pointer, and read their levels", onclick: () => turned(glass.hidden) }, "Magnifier");
  let under = null; // where the pointer is, as a share of the picture

  function turned(on) {
    glass.hidden = !on;
    button.setAttribute("aria-pressed", String(on));
    picked.textContent = "";
    drawn();
  }

  function drawn() {
    if (glass.hidden || !under || !image.naturalWidth) return;
    const x = Math.floor(under.x * image.naturalWidth), y = Math.floor(under.y * image.naturalHeight);
    const pen = glass.getContext("2d", { willReadFrequently: true }), half = (GLASS - 1) / 2;
    pen.imageSmoothingEnabled = false;
    pen.clearRect(0, 0, glass.width, glass.height);
    pen.drawImage(image, x - half, y - half, GLASS, GLASS, 0, 0, glass.width, glass.height);
    const [red, green, blue, alpha] = pen.getImageData((half + 0.5) * LARGER, (half + 0.5) * LARGER, 1, 1).data;
    pen.strokeStyle = getComputedStyle(page.el).getPropertyValue("--accent");
    pen.strokeRect(half * LARGER - 0.5, half * LARGER - 0.5, LARGER + 1, LARGER + 1);
    const inside = x >= 0 && y >= 0 && x < image.naturalWidth && y < image.naturalHeight;
    const levels = [red, green, blue, ...(alpha < 255 ? [alpha] : [])].join(" ");
    picked.textContent = inside ? `pixel ${x}, ${y} · levels ${levels}` : "";
  }

  canvas.addEventListener("pointermove", (event) => {
    if (!page.about) return;
    const box = page.steering.frame(), outer = canvas.getBoundingClientRect();
    under = { x: (event.clientX - box.left) / box.width, y: (event.clientY - box.top) / box.height };
    const beside = event.clientX - outer.left > outer.width / 2 ? -glass.width - 20 : 20;
    glass.style.left = `${event.clientX - outer.left + beside}px`;
    glass.style.top = `${between(0, event.clientY - outer.top - glass.height / 2, outer.height - glass.height)}px`;
    drawn();
  });
  image.addEventListener("load", drawn);
  canvas.append(glass);
  return { button };
}
