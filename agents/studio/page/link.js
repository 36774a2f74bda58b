// The WebSocket of a page, and what every page shows of it: progress, errors, a lost connection.
import { text } from "./texts.js";

export const by = id => document.getElementById(id);

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
      else if (message.type === "error") { showError(message.key ? text(message.key, message.values) : message.text); on.error?.(message); }
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

/** Make an element with properties, with a key of its text (t), and with what it holds. */
export function make(tag, { t, ...properties } = {}, ...children) {
  const one = Object.assign(document.createElement(tag), properties);
  if (t) one.dataset.t = t;
  one.append(...children);
  return one;
}

/** A name in words, where a text of the kind and the name is known. */
export function named(kind, name) {
  const t = `${kind}_${name}`;
  return text(t) === t ? name : text(t);
}

/** An option of a value, in words where they are known. */
export function option(kind, name, value = name) {
  const words = named(kind, name);
  return words === name ? new Option(name, value) : make("option", { value, t: `${kind}_${name}` }, words);
}

/** Options of places, which have names where they are scenes. */
export const places = rows => rows.map(([value, group, name]) => option(group === "scene" || group === "twin" ? "p" : group, name, value));

/** A mark in a colour of the theme. */
export const mark = colour => make("span", { className: "key", style: `background: var(--${colour})` });

/** Move a slider to its end, from its begin if it is there, and show each place; return the timer. */
export function play(slider, show, step, period) {
  if (Number(slider.value) >= Number(slider.max)) slider.value = 0;
  const timer = setInterval(() => {
    slider.value = Number(slider.value) + step;
    show();
    if (Number(slider.value) >= Number(slider.max) - step / 2) clearInterval(timer);
  }, period);
  return timer;
}

/** Make elements from HTML with texts, and find those with an id of theirs. */
export function build(root, html) {
  root.innerHTML = html;
  return Object.fromEntries([...root.querySelectorAll("[id]")].map(one => [one.id, one]));
}
