// Keys, gamepad and touch stick as one deflection: forward and to the left, in [-1, 1].
const KEYS = { ArrowUp: "up", KeyW: "up", ArrowDown: "down", KeyS: "down", ArrowLeft: "left", KeyA: "left", ArrowRight: "right", KeyD: "right" };
const TURN = 0.6; // of the full turn rate that a key asks for
const IDLE = 0.12; // dead zone of a gamepad's stick

const typing = event => event.target.closest?.("select, input, textarea, [contenteditable]");

export class Inputs {
  /** @param {Element} stick touch stick @param {function} changed called when a deflection changes at once */
  constructor(stick, changed) {
    this.held = new Set();
    this.slow = false;
    this.touch = [0, 0];
    this.stick = stick;
    this.changed = changed;
    this.only = ""; // keyboard, gamepad or touch; empty: all of them
    this.ending = new AbortController();
    const on = (target, type, act) => target.addEventListener(type, act, { signal: this.ending.signal });
    on(window, "keydown", event => this.key(event, true));
    on(window, "keyup", event => this.key(event, false));
    on(window, "blur", () => this.release());
    on(document, "visibilitychange", () => { if (document.hidden) this.release(); });
    on(stick, "pointerdown", event => { stick.setPointerCapture(event.pointerId); this.drag(event); });
    on(stick, "pointermove", event => { if (stick.hasPointerCapture(event.pointerId)) this.drag(event); });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) on(stick, end, () => this.point(0, 0));
  }

  close() { this.ending.abort(); this.release(); }

  release() { this.held.clear(); this.slow = false; this.point(0, 0); }

  key(event, down) {
    this.slow = event.shiftKey;
    const name = KEYS[event.code];
    if (!name || (down && (event.ctrlKey || event.altKey || event.metaKey || typing(event)))) return;
    if (down) event.preventDefault();
    if (down === this.held.has(name)) return;
    if (down) this.held.add(name); else this.held.delete(name);
    this.changed();
  }

  drag(event) {
    const box = this.stick.getBoundingClientRect(), half = box.width / 2;
    let x = (event.clientX - box.left - half) / (half * 0.8), y = (event.clientY - box.top - half) / (half * 0.8);
    const size = Math.hypot(x, y);
    if (size > 1) { x /= size; y /= size; }
    this.point(-y, -x);
  }

  point(forward, left) {
    this.touch = [forward, left];
    const knob = this.stick.firstElementChild, half = this.stick.clientWidth * 0.4;
    if (knob) knob.style.transform = `translate(${-left * half}px, ${-forward * half}px)`;
    this.changed();
  }

  gamepad() {
    for (const pad of navigator.getGamepads?.() ?? []) {
      if (!pad || pad.axes.length < 2) continue;
      const past = value => (Math.abs(value) < IDLE ? 0 : (value - Math.sign(value) * IDLE) / (1 - IDLE));
      const found = [-past(pad.axes[1]), -past(pad.axes[0])];
      if (found[0] || found[1]) return found.map(one => Math.max(-1, Math.min(1, one)));
    }
    return [0, 0];
  }

  /** Whether a button of a gamepad has gone down since the last call. */
  clicked() {
    const before = this.down;
    this.down = [...navigator.getGamepads?.() ?? []].some(pad => pad?.buttons?.some(one => one.pressed));
    return this.down && !before;
  }

  /** The deflection now, and by what: of the touch stick, else of a gamepad, else of keys; or of `only` one of them. */
  deflection() {
    const may = by => !this.only || this.only === by, pad = this.gamepad();
    if (may("touch") && (this.touch[0] || this.touch[1] || this.only)) return { by: "touch", at: this.touch };
    if (may("gamepad") && (pad[0] || pad[1] || this.only)) return { by: "gamepad", at: pad };
    const is = name => (this.held.has(name) ? 1 : 0), share = this.slow ? 0.5 : 1;
    return { by: "keyboard", at: [share * (is("up") - is("down")), share * TURN * (is("left") - is("right"))] };
  }
}
