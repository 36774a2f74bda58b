// The page Compare: two drives of one episode beside each other, with one clock.
import { build, Link, make, named, option, places, play, say, showError } from "./link.js";
import { text } from "./texts.js";
import { drawActors, drawChair, drawGoal, drawWorld, View } from "./view.js";

const SIDES = ["left", "right"];
const FIGURES = {
  f_outcome: one => text(`o_${one.outcome}`), r_time: one => `${one.time.toFixed(1)} s`, f_length: one => `${one.length.toFixed(2)} m`,
  r_least: one => `${one.clearance_min.toFixed(3)} m`, r_energy: one => `${one.energy.toFixed(2)} Wh`,
};
const T = 0, POSE = 1, TWIST = 4, GIVEN = 6, STICK = 8, CLEARANCE = 10; // columns of a state

/** A policy or an assistant in words. */
const shown = name => named("n", named("y", name));

export class ComparePage {
  constructor(root, looks) {
    this.looks = looks;
    this.on = build(root, document.getElementById("compare-page").innerHTML);
    this.tracks = {};
    this.views = Object.fromEntries(SIDES.map(name => [name, new View(this.on[`map-${name}`], () => this.draw(name))]));
    this.listen();
    this.show();
    this.link = new Link("compare", {
      choices: message => { this.on.place.replaceChildren(...places(message.places)); this.on.place.value = message.first; },
      sources: message => this.choose(message), run: message => this.chosen(message), track: message => this.take(message),
      driving: message => this.banner(text("drives_now", { name: shown(message.name) })), error: () => { this.busy(false); this.banner(""); },
      lost: () => this.busy(true),
    });
  }

  close() {
    clearInterval(this.playing);
    for (const view of Object.values(this.views)) view.close();
    this.link.close();
  }

  restyle(looks) {
    this.looks = looks;
    for (const name of SIDES) { this.views[name].restyle(); this.draw(name); }
    this.list();
  }

  listen() {
    const on = this.on, whole = one => Math.max(0, Math.trunc(one.valueAsNumber) || 0);
    const order = (type, content) => { showError(""); this.busy(true); this.link.send(type, content); };
    on.form.onsubmit = event => {
      event.preventDefault();
      this.expected = 2;
      order("pair", { place: on.place.value, seed: whole(on.seed), driver: on.driver.value, left: on.left.value, right: on.right.value });
    };
    on.driver.onchange = () => this.fill();
    on.opening.onsubmit = event => event.preventDefault();
    for (const name of SIDES) {
      on[`open-${name}`].onclick = () => { this.expected = 1; order("open", { side: name, name: on.file.value, episode: whole(on.number) }); };
    }
    on.run.onchange = () => this.link.send("choose", { run: on.run.value });
    on.again.onsubmit = event => {
      event.preventDefault();
      const [scene, seed] = JSON.parse(on.scene.value || "[]");
      if (scene === undefined) return;
      this.expected = 2;
      order("run", { run: on.run.value, scene, seed, left: on["run-left"].value, right: on["run-right"].value });
    };
    on.time.oninput = () => { clearInterval(this.playing); this.show(); };
    on.play.onclick = () => this.play();
    on.contact.onclick = () => this.jump(event => event[1] === "contact");
    on.event.onclick = () => this.jump(() => true);
  }

  busy(is) {
    for (const name of ["go", "open-left", "open-right", "rerun"]) this.on[name].disabled = is;
    if (!is) this.on.rerun.disabled = !this.on.scene.options.length;
    this.on["open-left"].disabled = this.on["open-right"].disabled = is || !this.on.file.options.length;
  }

  choose(message) {
    this.sources = message;
    const options = names => names.map(name => new Option(name, name));
    this.on.driver.replaceChildren(...message.drivers.map(name => option("h", name)));
    this.on.driver.value = "novice";
    this.on.file.replaceChildren(...options(message.recordings));
    this.on.run.replaceChildren(...options(message.runs));
    this.on.opening.hidden = !this.on.file.options.length;
    this.on.again.hidden = !message.runs.length;
    this.fill();
    this.busy(false);
    if (message.runs.length) this.on.run.onchange();
  }

  /** Policies, or the assistants of a person. */
  fill() {
    const { policies, assistants, drivers } = this.sources, nobody = this.on.driver.value === drivers[0];
    for (const [name, first] of [["left", nobody ? "lattice+window" : "direct"], ["right", nobody ? "ppo_guided" : "shared_dwa"]]) {
      this.on[name].replaceChildren(...(nobody ? policies : assistants).map(one => option(nobody ? "y" : "n", one)));
      this.on[name].value = first;
    }
  }

  chosen(message) {
    this.on.scene.replaceChildren(...message.episodes.map(([scene, seed]) => new Option(`${scene}, ${seed}`, JSON.stringify([scene, seed]))));
    for (const [k, name] of [[0, "run-left"], [1, "run-right"]]) {
      this.on[name].replaceChildren(...message.policies.map(one => new Option(one, one)));
      this.on[name].value = message.policies[Math.min(k, message.policies.length - 1)];
    }
    this.busy(false);
  }

  take(message) {
    this.tracks[message.side] = message;
    this.views[message.side].bounds = message.world.bounds;
    this.expected -= 1;
    if (this.expected <= 0) { this.busy(false); this.banner(text("compare_ready")); say(text("compare_ready")); }
    const all = Object.values(this.tracks), end = Math.max(...all.map(one => one.states.at(-1)[T]));
    this.on.time.max = end;
    this.on.time.value = 0;
    this.on.play.disabled = false;
    this.on.event.disabled = !all.some(one => one.events.length);
    this.on.contact.disabled = !all.some(one => one.events.some(event => event[1] === "contact"));
    this.list();
    this.show();
  }

  list() {
    for (const name of SIDES) {
      const track = this.tracks[name];
      if (!track) continue;
      this.on[`name-${name}`].textContent = this.on[`head-${name}`].textContent = shown(track.name);
      this.on[`events-${name}`].replaceChildren(...track.events.slice(0, 60).map(([t, kind, more]) =>
        make("button", { onclick: () => this.go(t) }, `${t.toFixed(1)} s ${text(`e_${kind}`)}${more ? `: ${text(more)}` : ""}`)));
    }
    this.on.rows.replaceChildren(...Object.entries(FIGURES).map(([name, value]) => make(
      "tr", {}, make("th", { scope: "row" }, text(name)),
      ...SIDES.map(one => make("td", {}, this.tracks[one] ? value(this.tracks[one].figures) : "–")),
    )));
  }

  play() {
    clearInterval(this.playing);
    this.playing = play(this.on.time, () => this.show(), 0.1, this.looks.still ? 1000 : 50);
  }

  go(time) {
    clearInterval(this.playing);
    this.on.time.value = time;
    this.show();
  }

  /** The next event of either side after the clock; after the last one, the first. */
  jump(wanted) {
    const times = Object.values(this.tracks).flatMap(one => one.events.filter(wanted).map(([t]) => t)).sort((a, b) => a - b);
    if (times.length) this.go(times.find(t => t > Number(this.on.time.value) + 0.06) ?? times[0]);
  }

  show() {
    this.on.clock.textContent = text("clock", { time: Number(this.on.time.value).toFixed(1) });
    for (const name of SIDES) this.draw(name);
  }

  banner(what) { this.on.banner.textContent = what; }

  /** The number of the state at the clock, or of the last one. */
  at(track) {
    const time = Number(this.on.time.value) + 1e-6;
    return Math.max(0, track.states.findLastIndex(state => state[T] <= time));
  }

  draw(name) {
    const track = this.tracks[name], view = this.views[name];
    if (!track) return;
    const k = this.at(track), state = track.states[k], { world } = track, [forward, , turn] = world.limits;
    const now = {
      pose: state.slice(POSE, POSE + 3), given: state.slice(GIVEN, GIVEN + 2), stick: [state[STICK] / forward, state[STICK + 1] / turn],
      contact: track.events.some(([t, kind]) => kind === "contact" && Math.abs(t - state[T]) < 0.3),
    };
    view.begin();
    drawWorld(view, world);
    view.line(track.states.slice(0, k + 1).map(one => one.slice(POSE, POSE + 2)), view.colour.trail, 2);
    drawGoal(view, world.goal, world.tolerance);
    drawActors(view, world.actors, track.actors[k]);
    drawChair(view, world, now);
    view.end();
    this.on[`says-${name}`].textContent = text("says", {
      speed: state[TWIST].toFixed(2), clearance: state[CLEARANCE].toFixed(2), end: state[T] + 1e-6 < Number(this.on.time.value) ? text("ended_at", { time: state[T].toFixed(1) }) : "",
    });
  }
}
