// The WebSocket of a page, and what every page shows of it: progress, errors, a lost connection.
import { text } from "./texts.js";

const by = id => document.getElementById(id);

/** Tell people who listen to the page. */
export function say(what) { by("said").textContent = what; }

export function showError(what) {
  by("error").hidden = !what;
  by("error").textContent = what;
}

function showProgress(state) {
  by("progress").hidden = state.ready && !state.error;
  const values = { ...state, seconds: state.seconds.toFixed(0) };
  by("progress-text").textContent = state.error || text(state.compiling ? "compile_text" : "load_text", values);
  by("progress-bar").value = state.share;
}

export class Link {
  /**
   * @param {string} page name of the session
   * @param {Object<string, function>} on what to do with each type of message, and with a `picture`
   */
  constructor(page, on) {
    this.socket = new WebSocket(`ws://${location.host}/session/${page}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = event => {
      if (typeof event.data !== "string") { this.picture(event.data, on.picture); return; }
      const message = JSON.parse(event.data);
      if (message.type === "progress") { showProgress(message); on.progress?.(message); }
      else if (message.type === "error") { showError(message.text); on.error?.(message); }
      else on[message.type]?.(message);
    };
    this.socket.onclose = () => { if (!this.closed) { by("lost").hidden = false; by("progress").hidden = true; on.lost?.(); } };
  }

  /** A picture: length of the head, the head as JSON, and ranges in millimetres. */
  picture(buffer, draw) {
    const length = new DataView(buffer).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    draw(head, new Uint16Array(buffer, 4 + length));
  }

  send(type, content = {}) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ type, ...content }));
  }

  close() { this.closed = true; this.socket.close(); }
}

/** Make elements from HTML with texts, and find those with an id of theirs. */
export function build(root, html) {
  root.innerHTML = html;
  return Object.fromEntries([...root.querySelectorAll("[id]")].map(one => [one.id, one]));
}
