// The object fills the view: small pictures tell how much of them it takes, and the camera is
// placed accordingly. They are not shown.

const TRIES = 4;
const LONG = 256; // px of the longer side
const APART = 12; // levels from the background
const MARKS = ["axes", "cube", "scale-bar"]; // options that draw at the picture's sides

// Sides of what differs from the background, as shares of the picture; null: nothing does.
async function seenIn(bytes, type) {
  const image = await createImageBitmap(new Blob([bytes], { type }));
  const { width, height } = image, pen = new OffscreenCanvas(width, height).getContext("2d");
  pen.drawImage(image, 0, 0);
  const { data } = pen.getImageData(0, 0, width, height);
  let [left, right, top, bottom] = [width, -1, height, -1];
  for (let n = 0; n < data.length; n += 4) {
    if (![0, 1, 2, 3].some((k) => Math.abs(data[n + k] - data[k]) > APART)) continue;
    const x = (n / 4) % width, y = Math.floor(n / 4 / width);
    left = Math.min(left, x);
    right = Math.max(right, x);
    top = Math.min(top, y);
    bottom = Math.max(bottom, y);
  }
  return right < 0 ? null : { left: left / width, right: (right + 1) / width, top: top / height, bottom: (bottom + 1) / height };
}

export function filling(page) {
  let tries = 0, awaited = -1, ended = () => {};

  function asked() {
    const settings = { ...page.settings };
    for (const key of MARKS) delete settings[key];
    const { width, height } = page.size(), scale = Math.min(1, LONG / Math.max(width, height));
    const small = { width: Math.max(8, Math.round(width * scale)), height: Math.max(8, Math.round(height * scale)) };
    awaited = page.say("draw", { moving: false, settings, ...small });
  }

  // Begin; `then` is called once the object fills the view, or can not.
  function begun(then) {
    tries = TRIES;
    ended = then;
    asked();
  }

  function finished() {
    awaited = -1;
    ended();
  }

  // Whether a frame is one of these pictures
  function takes(head, bytes) {
    if (head.number !== awaited) return false;
    tries -= 1;
    seenIn(bytes, head.type).then((box) => {
      if (head.number !== awaited) return; // something else was wished meanwhile
      const isNear = box === null || page.steering.filled(box, tries === TRIES - 1);
      if (isNear || tries === 0) finished(); else asked();
    });
    return true;
  }

  // Something else is wished; or it went wrong
  const stopped = () => { awaited = -1; };

  return { begun, takes, stopped, failed: (number) => number === awaited && finished() };
}
