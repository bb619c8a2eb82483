// Elements of the page, and numbers as texts of options hold them.

export function made(kind, given = {}, ...children) {
  const element = document.createElement(kind);
  for (const [name, value] of Object.entries(given)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && typeof value !== "string") element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

export function svg(kind, given = {}) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", kind);
  for (const [name, value] of Object.entries(given)) element.setAttribute(name, value);
  return element;
}

export function rounded(number) {
  return String(Number(number.toPrecision(6)));
}

export function between(low, number, high) {
  return Math.min(high, Math.max(low, number));
}

// An image that shows the latest bytes it was given.
export function hung(image, bytes, type) {
  URL.revokeObjectURL(image.src);
  image.src = URL.createObjectURL(new Blob([bytes], { type }));
}

export function download(name, bytes) {
  const address = URL.createObjectURL(new Blob([bytes]));
  made("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}
