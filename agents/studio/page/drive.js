// The page Drive: a form, the picture, the inputs, and the figures of the drive.
import { build, Link, make, mark, option, places, say, showError } from "./link.js";
import { Inputs } from "./inputs.js";
import { text, translate } from "./texts.js";
import { drawActors, drawChair, drawGoal, drawSenses, drawVeil, drawWorld, View } from "./view.js";

const READINGS = {
  r_time: now => `${now.t.toFixed(1)} s`, r_speed: now => `${now.twist[0].toFixed(2)} m/s`,
  r_clearance: now => `${now.clearance.toFixed(2)} m`, r_least: now => `${now.least.toFixed(2)} m`,
  r_to_go: now => (now.to_go === null ? "–" : `${now.to_go.toFixed(1)} m`), r_energy: now => `${now.energy.toFixed(2)} Wh`,
  r_battery: now => `${now.battery.toFixed(1)} V`,
};
const LEGEND = ["goal", "laser", "ultrasonic", "person", "door", "track", "asked", "given"]; // names of colours and of texts
const COMMANDS = ["forward", "left", "right", "back"];
const PERIOD = 25; // ms between two messages of a stick that is moved
const SLOWER = 0.05; // m/s less than asked
const ENOUGH = 480; // pixels of height for map, message and stick
const TRAIL = 3000; // points that are drawn

export class DrivePage {
  /** @param {string} session its name at the server */
  constructor(root, looks, session = "drive") {
    this.session = session;
    this.looks = looks;
    this.on = build(root, document.getElementById("drive-page").innerHTML);
    this.view = new View(this.on.map, () => this.draw());
    this.sent = [0, 0];
    this.trail = [];
    this.running = false;
    this.inputs = new Inputs(this.on.stick, () => this.steer());
    this.timer = setInterval(() => this.steer(), PERIOD);
    this.listen();
    this.fill();
    this.watch = new ResizeObserver(() => this.size());
    this.watch.observe(document.body);
    this.link = new Link(this.session, this.answers());
  }

  /** What to do with each type of message. */
  answers() {
    return {
      choices: message => this.choose(message), progress: state => this.prepared(state), busy: () => { this.waiting = true; this.banner(text("busy")); },
      world: message => this.begin(message), picture: (head, ranges) => this.take(head, ranges), ended: message => this.end(message),
      unbegun: () => { this.running = false; this.buttons(); this.banner(text("end_stopped")); },
      assist: message => { if (message.anew) say(text("anew")); }, paused: message => this.pausedNow(message.on),
      filming: () => { this.on.film.disabled = true; this.banner(text("filming")); },
      film: message => this.filmed(message.file), error: () => { this.on.start.disabled = false; this.on.film.disabled = this.waiting = false; if (!this.running) this.banner(""); },
      lost: () => { this.running = false; this.buttons(); },
    };
  }

  close() {
    clearInterval(this.timer);
    this.inputs.close();
    this.view.close();
    this.watch.disconnect();
    this.ending.abort();
    this.link.close();
  }

  listen() {
    const on = this.on, link = (type, content) => this.link.send(type, content);
    this.ending = new AbortController();
    on.form.onsubmit = event => { event.preventDefault(); this.start(); };
    on.next.onclick = () => { on.seed.value = Number(on.seed.value) + 1; this.start(); };
    on.place.onchange = () => this.about();
    on.assist.onchange = () => { this.about(); link("assist", { name: on.assist.value }); };
    on.hand.onchange = () => link("hand", { name: on.hand.value });
    on.sight.onchange = () => { this.about(); link("sight", { name: on.sight.value }); };
    on.device.onchange = on.period.onchange = () => this.device();
    on.pause.onclick = () => link("pause", { on: !this.paused });
    on.stop.onclick = () => link("stop");
    on.film.onclick = () => link("film");
    on.switch.onclick = () => link("press");
    on.in.onclick = () => this.view.zoomTo(this.view.zoom * 1.5);
    on.out.onclick = () => this.view.zoomTo(this.view.zoom / 1.5);
    on.fit.onclick = () => this.view.zoomTo(1);
    on.heading.onclick = () => { this.headingUp = !this.headingUp; on.heading.setAttribute("aria-pressed", this.headingUp); this.draw(); };
    addEventListener("keydown", event => {
      if (event.target.closest?.("select, input") || event.ctrlKey || event.metaKey || event.altKey) return;
      const act = { Escape: on.stop.onclick, "+": on.in.onclick, "-": on.out.onclick, 0: on.fit.onclick }[event.key];
      if (act) act();
      if (event.key === "p" && on.pause.isConnected && this.running) on.pause.onclick();
    }, { signal: this.ending.signal });
    // While a single switch drives, its press goes to the chair, whatever has the focus.
    for (const type of ["keydown", "keyup"]) {
      addEventListener(type, event => {
        if (!this.switched || ![" ", "Enter"].includes(event.key)) return;
        event.preventDefault();
        event.stopPropagation();
        if (type === "keydown" && !event.repeat) link("press");
      }, { signal: this.ending.signal, capture: true });
    }
  }

  /** Give map, message and stick what is left of the screen, or all of it where that is too little. */
  size() {
    const top = this.on.stage.getBoundingClientRect().top + scrollY;
    this.on.stage.style.setProperty("--top", `${innerHeight - top > ENOUGH ? top : 0}px`);
  }

  fill() {
    this.on.scan.replaceChildren(...COMMANDS.map(name => make("li", { t: name })));
    this.on.legend.replaceChildren(...LEGEND.map(name => make("li", {}, mark(name), make("span", { t: `k_${name}` }))));
    this.on.readings.replaceChildren(...[...Object.keys(READINGS), "r_shield"].map(name => {
      this.on[name] = make("dd", { id: name }, "–");
      return make("div", {}, make("dt", { t: name }), this.on[name]);
    }));
  }

  restyle(looks) {
    this.looks = looks;
    this.view.restyle();
    this.about();
    this.draw();
  }

  choose(message) {
    const groups = { map: "maps", scene: "scenes", twin: "twins", suite: "suites" };
    this.on.place.replaceChildren(...Object.entries(groups).flatMap(([group, key]) => {
      const of = places(message.places.filter(place => place[1] === group));
      return of.length ? [make("optgroup", { label: text(key) }, ...of)] : [];
    }));
    this.on.assist.replaceChildren(...message.assistants.map(name => option("n", name)));
    this.on.place.value = message.first;
    this.on.assist.value = message.assistant;
    this.on.hand.replaceChildren(...message.hands.map(name => option("h", name)));
    this.on.sight.replaceChildren(...message.sights.map(name => option("s", name)));
    this.on.rate.replaceChildren(...message.rates.map(rate => new Option(`${rate} Hz`, rate)));
    this.on.rate.value = 20;
    translate(this.on.form);
    this.about();
    this.chosen = true;
    this.first();
  }

  prepared(state) {
    this.ready = state.ready;
    this.on.start.disabled = this.on.next.disabled = !state.ready;
    if (this.waiting && state.kernel) this.banner(`${text("busy")}. ${text("compile_now", state)}`);
    this.first();
  }

  /** The first drive begins by itself. */
  first() {
    if (!this.ready || !this.chosen || this.begun) return;
    this.begun = true;
    this.start();
  }

  about() {
    const known = key => (text(key) === key ? "" : text(key)), [kind, name] = (this.on.place.value ?? "").split(":").slice(-2);
    this.on.there.textContent = known(`q_${kind === "suite" ? "" : name ?? kind}`);
    this.on.about.textContent = `${known(`a_${this.on.assist.value}`)} (${this.on.assist.value})`;
    this.on.unseen.textContent = known(`u_${this.on.sight.value}`);
  }

  start() {
    const on = this.on;
    showError("");
    on.start.disabled = true;
    on.results.hidden = true;
    this.device();
    this.link.send("start", {
      place: on.place.value, seed: Math.max(0, Math.trunc(Number(on.seed.value)) || 0), assist: on.assist.value,
      hand: on.hand.value, sight: on.sight.value, rate: Number(on.rate.value),
    });
  }

  device() {
    const single = this.on.device.value === "switch";
    this.on.switching.hidden = this.on.scanning.hidden = !single;
    this.on.stick.hidden = single;
    const period = Math.min(10, Math.max(0.3, Number(this.on.period.value) || 1.25));
    this.link.send("device", { name: this.on.device.value, scan_period: period });
  }

  begin(message) {
    this.world = message;
    this.view.bounds = message.bounds;
    this.trail = [];
    this.now = null;
    this.running = true;
    this.waiting = this.paused = false;
    this.on.start.disabled = false;
    this.on.results.hidden = true;
    this.on.seed.value = message.order.seed;
    this.size();
    this.on.stage.scrollIntoView({ block: "nearest" });
    this.on.map.focus({ preventScroll: true });
    showError(message.note ? text("not_recorded", { text: message.note }) : "");
    this.buttons();
    say(text("waiting"));
  }

  buttons() {
    this.on.pause.disabled = this.on.stop.disabled = !this.running;
    this.on.pause.textContent = text(this.paused ? "resume" : "pause");
  }

  pausedNow(on) {
    this.paused = on;
    this.buttons();
    this.status();
  }

  /** A single switch drives now, and this page gets its presses. */
  get switched() { return this.running && !this.paused && this.on.device.value === "switch" && !document.hidden && document.hasFocus(); }

  steer() {
    if (this.inputs.clicked() && this.switched) this.link.send("press");
    const single = this.on.device.value === "switch";
    if (!(single ? this.switched : this.running) || this.hidden) return; // nobody drives a chair that is not shown
    const speed = Number(this.on.speed.value), { by, at } = single ? { by: "switch", at: [0, 0] } : this.inputs.deflection(), [forward, left] = at.map(one => one * speed);
    const moved = forward !== this.sent[0] || left !== this.sent[1];
    if (!moved && !forward && !left && !single) return;
    const now = performance.now();
    if (!moved && now - this.sentAt < PERIOD - 5) return;
    this.sent = [forward, left];
    this.sentAt = now;
    this.link.send("stick", { forward, left, by });
  }

  take(head, ranges) {
    if (!this.world) return;
    this.now = head;
    this.ranges = ranges;
    const [x, y] = head.pose, last = this.trail.at(-1);
    if (!last || Math.hypot(x - last[0], y - last[1]) > 0.03) this.trail.push([x, y]);
    if (this.trail.length > TRAIL) this.trail.splice(0, 100);
    this.follow(x, y);
    this.draw();
    for (const [name, shown] of Object.entries(READINGS)) this.on[name].textContent = shown(head);
    const shield = this.world.shielded ? head.reason || "shield_free" : "shield_off";
    this.on.r_shield.textContent = text(shield);
    this.on.scan.querySelectorAll("li").forEach(one => one.classList.toggle("lit", one.dataset.t === head.lit));
    this.status();
  }

  /** Keep the chair in view; with reduced motion the picture stays until the chair nears its edge. */
  follow(x, y) {
    const at = this.view.centre, size = Math.min(this.view.canvas.width, this.view.canvas.height) / this.view.scale;
    if (!at || !this.looks.still || Math.max(Math.abs(x - at[0]), Math.abs(y - at[1])) > 0.35 * size) this.view.centre = [x, y];
  }

  /** Backward the chair drives slower than it was asked to, or not at all, since it cannot look there. */
  get backs() {
    const { given, stick, reason } = this.now;
    return stick[0] < 0 && given[0] - stick[0] * this.world.limits[1] > SLOWER && (!reason || reason === "unseen");
  }

  status() {
    if (!this.running || !this.now) return;
    const now = this.now;
    if (this.paused) this.banner(text("paused"));
    else if (now.stands.length) this.banner(text("stands", { text: now.stands.join("; ") }), "alarm");
    else if (this.backs) this.banner(text("reverse", { limit: Math.max(0, -now.given[0]).toFixed(2) }), "alarm");
    else if (now.reason) this.banner(`${text("r_shield")}: ${text(now.reason)}`, "alarm");
    else this.banner(text(now.waits ? "waiting" : "driving"));
  }

  banner(what, kind = "") {
    if (this.on.banner.textContent !== what) this.on.banner.textContent = what;
    this.on.banner.className = `banner ${kind}`;
  }

  end(message) {
    this.running = false;
    this.result = message;
    this.buttons();
    const words = text(`end_${message.outcome}`);
    this.banner(words, message.outcome === "success" ? "good" : message.outcome === "collision" ? "alarm" : "");
    this.on.outcome.textContent = words;
    this.on.figures.textContent = text("figures", {
      time: message.time.toFixed(1), length: message.length.toFixed(2), shortest: message.shortest?.toFixed(2) ?? "–",
      clearance: message.clearance_min.toFixed(2), energy: message.energy.toFixed(2), changed: (100 * message.changed).toFixed(0),
    });
    this.on.results.hidden = false;
    this.on.recording.hidden = this.on.film.hidden = !message.file;
    this.on.filmed.hidden = true;
    this.on.film.disabled = false;
    if (message.file) this.on.recording.href = `files/${message.file}`;
    say(`${words} ${this.on.figures.textContent}`);
  }

  filmed(file) {
    this.on.film.hidden = true;
    this.on.filmed.hidden = false;
    this.on.filmed.href = `files/${file}`;
    this.banner(text("film_ready"), "good");
  }

  draw() {
    if (!this.world || !this.now) return;
    const view = this.view;
    view.angle = this.headingUp ? Math.PI / 2 - this.now.pose[2] : 0;
    view.begin();
    drawWorld(view, this.world);
    view.line(this.trail, view.colour.trail, 2);
    drawSenses(view, this.world, this.now, this.ranges);
    drawActors(view, this.world.actors, this.now.actors);
    for (const [, x, y, vx, vy, radius] of this.now.tracks) {
      view.disc(x, y, radius + 0.08, null, view.colour.track);
      view.arrow(x, y, vx, vy, view.colour.track, 2);
    }
    drawVeil(view, this.world, this.now);
    drawGoal(view, this.world.goal, this.world.tolerance);
    drawChair(view, this.world, this.now);
    view.end();
  }
}
