// Drags, wheel, two fingers and keys on the picture: what they mean is the steering's; a click picks,
// and Enter picks what is in the middle.

// Two fingers zoom about what is between them, and move it.
function pinch(page) {
  const fingers = new Map();
  const middle = () => {
    const [a, b] = [...fingers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) };
  };
  return {
    isTwo: () => fingers.size === 2,
    put: (event) => fingers.set(event.pointerId, { x: event.clientX, y: event.clientY }),
    gone: (event) => fingers.delete(event.pointerId),
    moved: (event) => {
      const before = middle();
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      const now = middle();
      page.steering?.panned(now.x - before.x, now.y - before.y);
      if (before.apart > 1 && now.apart > 1) page.steering?.zoomed(now.apart / before.apart, now);
    },
  };
}

export function gestures(page) {
  const { canvas } = page;
  const fingers = pinch(page);
  let dragged = null, travelled = 0, isContrast = false;

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.put(event);
    isContrast = page.contrast.takes(event);
    dragged = event.isPrimary ? [event.clientX, event.clientY] : null;
    travelled = event.isPrimary ? 0 : Infinity; // two fingers pick nothing
  });
  canvas.addEventListener("pointermove", (event) => {
    if (fingers.isTwo()) { fingers.moved(event); return; }
    if (!dragged || !event.isPrimary) return;
    const dx = event.clientX - dragged[0], dy = event.clientY - dragged[1];
    dragged = [event.clientX, event.clientY];
    travelled += Math.abs(dx) + Math.abs(dy);
    if (travelled < 3) return;
    if (isContrast) page.contrast.dragged(dx, dy);
    else if (event.shiftKey || event.buttons & 6) page.steering?.panned(dx, dy);
    else page.steering?.turned(dx, dy);
  });
  canvas.addEventListener("pointerup", (event) => {
    if (dragged && travelled < 3 && page.about) page.say("pick", page.placeOf(event));
  });
  canvas.addEventListener("lostpointercapture", (event) => {
    fingers.gone(event);
    dragged = null;
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    page.steering?.zoomed(Math.exp(-event.deltaY / 600), { x: event.clientX, y: event.clientY });
  }, { passive: false });
  canvas.addEventListener("dblclick", (event) => page.steering?.toggled?.({ x: event.clientX, y: event.clientY }));
  page.el.getRootNode().addEventListener("keydown", (event) => {
    const at = event.composedPath()[0];
    if (event.key !== "?" || at?.matches?.("input:not([type=range], [type=checkbox]), textarea")) return;
    event.preventDefault();
    page.helped();
  });
  canvas.addEventListener("keydown", (event) => {
    if (event.target !== canvas || event.ctrlKey || event.metaKey) return; // a handle's
    const step = 12, by = {
      ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step],
    }[event.key];
    if (by) event.shiftKey ? page.steering?.panned(...by) : page.steering?.turned(...by);
    else if (event.key === "+" || event.key === "=") page.steering?.zoomed(1.15);
    else if (event.key === "-") page.steering?.zoomed(1 / 1.15);
    else if (event.key === "Enter" && page.about) {
      const { width, height } = page.size();
      page.say("pick", { x: width / 2, y: height / 2 });
    } else if (event.key === "Home") page.steering?.home();
    else if (event.key === "0") page.fitted();
    else if (event.key === "w") page.contrast.turned();
    else if (event.key === "s") page.scaled();
    else if (event.key === "1" && page.steering?.exact) page.steering.exact();
    else return;
    event.preventDefault();
    event.stopPropagation(); // a notebook has keys of its own
  });
}
