// How the picture is made without the page, and keyframes, through which films are made.

import { download, made } from "./elements.js";
import { BEGIN } from "./orbit.js";

export function exporting(page) {
  let keyframes = []; // cameras
  const dialog = made("dialog", { id: "exports" });
  const keyframe = made("button", { id: "keyframe", hidden: true,
    title: "Keep this camera as a keyframe; Export makes a film through all keyframes",
    onclick: () => remembered([...keyframes, page.steering.keyframe?.() ?? page.settings.camera ?? BEGIN]) }, "Keyframe");
  const button = made("button", { id: "export", onclick: () => page.say("export", { keyframes }) }, "Export");

  function remembered(cameras) {
    keyframes = cameras;
    keyframe.textContent = keyframes.length ? `Keyframe (${keyframes.length})` : "Keyframe";
  }

  function films(text) {
    return [
      made("button", { id: "film-make", onclick: () => { page.say("film", { keyframes }); dialog.close(); } }, "Make film.mp4"),
      made("button", { id: "film-stop", onclick: () => page.say("film", { keyframes: [] }) }, "Stop the film"),
      made("button", { id: "keyframes-save", onclick: () => download(page.about.film.file, text) }, `Save ${page.about.film.file}`),
      made("button", { id: "keyframes-forget", onclick: () => { remembered([]); dialog.close(); } }, "Delete keyframes"),
    ];
  }

  function exported(texts) {
    dialog.replaceChildren(
      ...Object.entries(texts).flatMap(([name, text]) => [
        made("strong", {}, name[0].toUpperCase() + name.slice(1)),
        made("button", { onclick: () => navigator.clipboard?.writeText(text) }, "Copy"),
        made("pre", { id: `export-${name}` }, text),
      ]),
      ...(texts.keyframes ? films(texts.keyframes) : []),
      made("button", { id: "close", onclick: () => dialog.close() }, "Close"),
    );
    if (!dialog.open) dialog.showModal();
  }

  return { dialog, keyframe, button, exported };
}
