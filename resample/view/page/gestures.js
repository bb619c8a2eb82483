// Drags, wheel and keys on the picture: what they mean is the steering's; a click picks, and Enter
// picks what is in the middle.

export function gestures(page) {
  const { canvas } = page;
  let dragged = null, travelled = 0;

  canvas.addEventListener("pointerdown", (event) => {
    if (!event.isPrimary) return; // a second finger
    canvas.setPointerCapture(event.pointerId);
    dragged = [event.clientX, event.clientY];
    travelled = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!dragged || !event.isPrimary) return;
    const dx = event.clientX - dragged[0], dy = event.clientY - dragged[1];
    dragged = [event.clientX, event.clientY];
    travelled += Math.abs(dx) + Math.abs(dy);
    if (travelled < 3) return;
    if (event.shiftKey || event.buttons & 6) page.steering?.panned(dx, dy);
    else page.steering?.turned(dx, dy);
  });
  canvas.addEventListener("pointerup", (event) => {
    if (dragged && travelled < 3 && page.about) page.say("pick", page.placeOf(event));
    dragged = null;
  });
  canvas.addEventListener("lostpointercapture", () => { dragged = null; });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    page.steering?.zoomed(Math.exp(-event.deltaY / 600));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    if (event.target !== canvas) return; // a handle's
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
    else return;
    event.preventDefault();
  });
}
