// The page in a browser: a socket of the server that it came from, which opens itself again.

import { show } from "./viewer.js";

function socket(address) {
  return (hooks) => {
    let open = null;
    const dial = () => {
      open = new WebSocket(address);
      open.binaryType = "arraybuffer";
      open.onmessage = ({ data }) => hooks.heard(data);
      open.onclose = () => { hooks.closed(); setTimeout(dial, 1000); };
    };
    dial();
    return { send: (text) => open.readyState === WebSocket.OPEN && open.send(text) };
  };
}

const token = new URLSearchParams(location.search).get("token");
show(document.getElementById("viewer"), socket(`ws://${location.host}/socket?token=${encodeURIComponent(token)}`));
