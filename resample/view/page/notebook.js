// The page in a notebook's cell (anywidget), which talks to the kernel. One model may be shown by
// several pages, which tell whom they mean.

import { made } from "./elements.js";
import { show } from "./viewer.js";

function kernel(model, name) {
  return (hooks) => {
    const hear = (content, buffers) => {
      if (content.page !== name) return;
      if (!buffers?.length) { hooks.heard(content.text); return; }
      const { buffer, byteOffset, byteLength } = buffers[0];
      hooks.heard(buffer.slice(byteOffset, byteOffset + byteLength));
    };
    let known = JSON.stringify(model.get("settings"));
    const chosen = () => {
      const settings = model.get("settings"), text = JSON.stringify(settings);
      if (text !== known) hooks.replaced({ ...settings });
      known = text;
    };
    model.on("msg:custom", hear);
    model.on("change:settings", chosen);
    model.send({ page: name, kind: "opened" });
    return {
      send: (text) => model.send({ page: name, kind: "told", text }),
      settled: (settings) => {
        const text = JSON.stringify(settings);
        if (text === known) return;
        known = text;
        model.set("settings", JSON.parse(text));
        model.save_changes();
      },
      close: () => {
        model.off("msg:custom", hear);
        model.off("change:settings", chosen);
        model.send({ page: name, kind: "closed" });
      },
    };
  };
}

function render({ model, el }) {
  const style = made("style", {}, model.get("_style")), root = made("main");
  el.attachShadow({ mode: "open" }).append(style, root);
  const name = Math.random().toString(36).slice(2); // randomUUID is for secure origins alone
  return show(root, kernel(model, name));
}

export default { render };
