// The page Plan: draw a map, let planners answer on it, and watch how they came to their paths.
import { build, Link, make, mark, named, places, play, say, showError } from "./link.js";
import { text } from "./texts.js";
import { drawGoal, drawWorld, View } from "./view.js";

const TOOLS = ["start", "goal", "wall", "door", "furniture", "free", "scale", "move"];
const COLOURS = 8; // of the theme's series
const STEP = 0.1; // m that a key moves the cursor
const GRID = 0.05; // m to which points snap

export class PlanPage {
  constructor(root, looks) {
    this.looks = looks;
    this.on = build(root, document.getElementById("plan-page").innerHTML);
    this.view = new View(this.on.map, () => this.draw(), event => this.tool === "move" || event.button === 1);
    this.shapes = [];
    this.history = []; // shapes, start and goal before each change
    this.answers = [];
    this.tool = "start";
    this.kinds = [];
    this.fill();
    this.listen();
    this.link = new Link("plan", {
      planners: message => this.choose(message), choices: message => this.on.place.replaceChildren(...places(message.places)), map: message => this.take(message),
      planning: message => { this.planner = named("l", message.planner); this.banner(text("planning", this)); },
      progress: state => { if (this.planner && state.kernel) this.banner(`${text("planning", this)}. ${text("compile_now", state)}`); },
      plan: message => { this.answers.push(message); this.list(); this.draw(); }, planned: () => this.planned(), growth: message => this.grow(message), saved: message => this.saved(message.files),
      loading: ({ stage }) => this.banner(text(`load_${stage}`)),
      error: () => { this.planner = ""; this.on.plan.disabled = false; this.on.cancel.hidden = true; this.banner(""); }, lost: () => { this.on.plan.disabled = true; },
    });
  }

  close() {
    clearInterval(this.playing);
    this.view.close();
    this.link.close();
  }

  restyle(looks) {
    this.looks = looks;
    this.view.restyle();
    this.list();
    this.draw();
  }

  fill() {
    const take = name => () => { this.tool = name; this.corner = null; this.draw(); };
    this.on.tools.append(...TOOLS.map(name => make(
      "label", { className: "check" },
      make("input", { type: "radio", name: "tool", value: name, checked: name === this.tool, id: `tool-${name}`, onchange: take(name) }),
      " ", make("span", { t: `t_${name}` }),
    )));
  }

  listen() {
    const on = this.on, number = (one, otherwise) => (Number.isFinite(one.valueAsNumber) ? one.valueAsNumber : otherwise);
    on.form.onsubmit = event => { event.preventDefault(); this.plan(); };
    on.take.onclick = () => { showError(""); this.link.send("place", { place: on.place.value, seed: Math.max(0, Math.trunc(number(on.seed, 0))) }); };
    on.blank.onclick = () => { showError(""); this.link.send("blank", { width: number(on.width, 10), height: number(on.height, 8) }); };
    on.files.onchange = () => this.upload([...on.files.files]);
    on.undo.onclick = () => { Object.assign(this, this.history.pop()); this.redraw(); };
    on.clear.onclick = () => { this.remember(); this.shapes = []; this.redraw(); };
    on.cancel.onclick = () => this.link.send("cancel");
    on.rescale.onclick = () => {
      const [x0, y0, x1, y1] = this.ruler, factor = number(on.true, 0) / Math.hypot(x1 - x0, y1 - y0);
      if (factor > 0) this.link.send("scale", { factor });
    };
    on["save-map"].onclick = () => this.save("map");
    on["save-problem"].onclick = () => this.save("problem");
    on.frame.oninput = () => { clearInterval(this.playing); this.showFrame(); };
    on.play.onclick = () => this.play();
    on.ungrow.onclick = () => { this.frames = null; on.growing.hidden = true; clearInterval(this.playing); this.draw(); };
    const at = event => this.snapped(this.view.place(event)), draws = event => this.tool !== "move" && event.pointerType !== "touch";
    on.map.onpointerdown = event => { if (draws(event) && event.button === 0) { on.map.setPointerCapture(event.pointerId); this.press(at(event)); } };
    on.map.onpointermove = event => { if (this.corner && draws(event)) { this.cursor = at(event); this.draw(); } };
    on.map.onpointerup = event => { if (this.corner && draws(event)) this.press(at(event), true); };
    on.map.onclick = event => { if (event.pointerType === "touch" && this.tool !== "move") this.press(at(event)); }; // a finger that is drawn along scrolls
    on.map.onkeydown = event => this.key(event);
    this.number = number;
  }

  snapped([x, y]) { return [x, y].map(one => Math.round(one / GRID) * GRID).map(one => Math.round(one * 1000) / 1000); }

  /** Keys move a cursor over the map; enter sets a point, as a click does. */
  key(event) {
    const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }, way = ways[event.key];
    if (!way && event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    this.cursor ??= this.start ?? [0, 0];
    if (way) {
      const far = event.shiftKey ? 5 * STEP : STEP;
      this.cursor = this.snapped([this.cursor[0] + far * way[0], this.cursor[1] + far * way[1]]);
      say(`${this.cursor[0].toFixed(2)}, ${this.cursor[1].toFixed(2)} m`);
      this.draw();
    } else this.press(this.cursor);
  }

  /** A point of the tool in hand: a place, or an end of a shape. */
  press(point, released = false) {
    if (this.tool === "start" || this.tool === "goal") {
      this.remember();
      this[this.tool] = point;
      this.forget();
    } else if (!this.corner) {
      this.corner = this.cursor = point;
    } else {
      const kind = this.kinds.indexOf(this.tool), [x, y] = this.corner;
      if (released && Math.hypot(point[0] - x, point[1] - y) < GRID) return; // a click: the other end follows
      this.corner = null;
      if (this.tool === "scale") this.measure([x, y, ...point]);
      else {
        this.remember();
        this.shapes.push([kind, x, y, ...point]);
        this.redraw();
      }
    }
    this.draw();
  }

  /** A line whose true length tells how large the map is. */
  measure(ruler) {
    this.ruler = ruler;
    this.on.scaling.hidden = false;
    this.on.true.value = Math.hypot(ruler[2] - ruler[0], ruler[3] - ruler[1]).toFixed(2);
    this.on.true.select();
  }

  remember() {
    this.history.push({ shapes: [...this.shapes], start: this.start, goal: this.goal });
    this.on.undo.disabled = false;
  }

  redraw() {
    this.on.undo.disabled = !this.history.length;
    this.on.clear.disabled = !this.shapes.length;
    this.link.send("draw", { shapes: this.shapes });
  }

  forget() {
    this.answers = [];
    this.frames = null;
    this.on.growing.hidden = true;
    this.list();
    this.banner(text("plan_ready"));
  }

  choose(message) {
    this.kinds = message.shapes;
    this.on.planners.replaceChildren(...message.names.map(name => make(
      "label", { className: "check" }, make("input", { type: "checkbox", value: name, checked: message.first.includes(name) }), " ", make("span", { t: `l_${name}` }, named("l", name)),
    )));
  }

  take(message) {
    this.world = message;
    this.view.bounds = message.bounds;
    if (message.start) {
      Object.assign(this, { start: message.start, goal: message.goal, shapes: [], history: [], ruler: null });
      this.on.undo.disabled = this.on.clear.disabled = this.on.scaling.hidden = this.on.cancel.hidden = true;
      this.view.zoomTo(1);
    }
    this.forget();
    this.draw();
  }

  plan() {
    const planners = [...this.on.planners.querySelectorAll("input:checked")].map(box => box.value);
    if (!planners.length) { showError(text("choose_planner")); return; }
    showError("");
    this.forget();
    this.on.plan.disabled = true;
    this.on.cancel.hidden = false;
    this.link.send("plan", {
      planners, start: this.start, goal: this.goal, clearance: this.number(this.on.clearance, 0.36),
      deadline: this.number(this.on.deadline, 1), seed: Math.max(0, Math.trunc(this.number(this.on.seed, 0))),
    });
  }

  planned() {
    this.planner = "";
    this.on.plan.disabled = false;
    this.on.cancel.hidden = true;
    const solved = this.answers.filter(one => one.length !== null).sort((a, b) => a.length - b.length);
    const words = solved.length ? text("best", { planner: named("l", solved[0].planner), length: solved[0].length.toFixed(2) }) : text("no_path");
    this.banner(words);
    say(words);
  }

  list() {
    const fixed = (value, digits) => (value === null ? "–" : value.toFixed(digits));
    const watch = ({ planner }) => {
      const button = make("button", { type: "button", ariaLabel: `${text("watch")}: ${named("l", planner)}` }, text("watch"));
      button.onclick = () => { this.banner(text("growing")); this.link.send("growth", { planner }); };
      return button;
    };
    this.on.rows.replaceChildren(...this.answers.map((one, k) => {
      const figures = [fixed(one.length, 2), fixed(one.clearance_min, 2), fixed(one.clearance_mean, 2), fixed(one.time_ms, 1)];
      return make(
        "tr", {}, make("th", { scope: "row" }, mark(`series-${k % COLOURS}`), named("l", one.planner)), make("td", { title: one.note }, one.status),
        ...figures.map(words => make("td", {}, words)), make("td", {}, ...one.grows ? [watch(one)] : []),
      );
    }));
  }

  grow(message) {
    this.frames = message.frames;
    this.grower = message.planner;
    this.on.growing.hidden = false;
    this.banner(text("grows"));
    this.on.frame.max = message.frames.length - 1;
    this.on.frame.value = this.looks.still ? message.frames.length - 1 : 0;
    this.showFrame();
    if (!this.looks.still) this.play();
  }

  play() {
    clearInterval(this.playing);
    this.playing = play(this.on.frame, () => this.showFrame(), 1, 120);
  }

  showFrame() {
    const frame = this.frames[Number(this.on.frame.value)];
    if (!frame) return;
    const length = frame.length === null ? "–" : frame.length.toFixed(2);
    this.on.grown.textContent = text("grown", { planner: named("l", this.grower), iterations: frame.iterations, length });
    this.draw();
  }

  async upload(files) {
    showError("");
    this.banner(text("load_read"));
    this.on.cancel.hidden = !files.length;
    for (const file of files) {
      const answer = await fetch(`maps/${encodeURIComponent(file.name)}`, { method: "POST", body: file });
      if (!answer.ok) { showError(`${file.name}: ${await answer.text()}`); this.on.cancel.hidden = true; this.banner(""); return; }
    }
    const main = files.find(file => /\.ya?ml$/i.test(file.name)) ?? files[0];
    if (main) this.link.send("load", { name: main.name, resolution: this.number(this.on.resolution, 0.05) });
    this.on.files.value = "";
  }

  save(what) {
    showError("");
    this.link.send("save", { what, name: this.on.name.value, start: this.start, goal: this.goal });
  }

  saved(files) {
    this.on.saved.replaceChildren(...files.flatMap(name => [make("a", { href: `files/${name}` }, name), " "]));
    say(files.join(", "));
  }

  banner(what) { if (this.on.banner.textContent !== what) this.on.banner.textContent = what; }

  draw() {
    if (!this.world) return;
    const view = this.view, frame = this.frames?.[Number(this.on.frame.value)];
    view.begin();
    drawWorld(view, this.world);
    if (frame) {
      view.segments(frame.tree, view.colour["series-5"], 1);
      for (const member of frame.swarm) view.line(member, view.colour["series-4"], 1);
      view.line(frame.path, view.colour.alarm, 4);
    } else this.answers.forEach((one, k) => view.line(one.path, view.colour[`series-${k % COLOURS}`], 3, k < COLOURS ? [] : [6, 4]));
    const radius = Number(this.on.clearance.value) || 0.1;
    view.disc(...this.start, radius, null, view.colour.start);
    view.disc(...this.start, 0.1, view.colour.floor, view.colour.start, 3);
    drawGoal(view, this.goal, radius);
    if (this.ruler) view.segments([this.ruler], view.colour.track, 4);
    if (this.corner) {
      const [x0, y0] = this.corner, [x1, y1] = this.cursor;
      if (["wall", "door", "scale"].includes(this.tool)) view.line([[x0, y0], [x1, y1]], view.colour.track, 4);
      else view.polygon([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], null, view.colour.track, 3);
    }
    if (this.cursor && document.activeElement === this.on.map) {
      const [x, y] = this.cursor, r = 8 * view.pixel;
      view.segments([[x - r, y, x + r, y], [x, y - r, x, y + r]], view.colour.track, 2);
    }
    view.end();
  }
}
