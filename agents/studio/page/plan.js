// The page Plan: draw a map, let planners answer on it, and watch how they came to their paths.
import { build, Link, say, showError } from "./link.js";
import { text } from "./texts.js";
import { drawGoal, drawWorld, View } from "./view.js";

const HTML = `<div class="page"><div class="stage">
  <canvas id="map" tabindex="0" role="img" data-label="plan_map_label"></canvas>
  <p id="banner" class="banner"></p>
  <div id="growing" hidden><label><span id="grown"></span><input id="frame" type="range" min="0" max="0" step="1" value="0"></label>
    <div class="row"><button id="play" type="button" data-t="play"></button><button id="ungrow" type="button" data-t="ungrow"></button></div></div>
  <fieldset id="tools" class="tools"><legend data-t="tool"></legend></fieldset>
  <div class="row"><button id="undo" type="button" data-t="undo" disabled></button><button id="clear" type="button" data-t="clear" disabled></button></div>
  <p class="hint" data-t="plan_hint"></p>
  <div class="wide"><table><caption class="hidden" data-t="answers"></caption><thead><tr>
    <th data-t="planner"></th><th data-t="status"></th><th data-t="length"></th><th data-t="clearance"></th><th data-t="mean_clearance"></th>
    <th data-t="took"></th><th data-t="growth"></th></tr></thead><tbody id="rows"></tbody></table></div>
  </div>
  <form id="form">
    <fieldset><legend data-t="planners"></legend><div id="planners" class="list"></div>
      <label><span data-t="keep_clear"></span><input id="clearance" type="number" min="0" max="2" step="0.01" value="0.36"></label>
      <label><span data-t="deadline"></span><input id="deadline" type="number" min="0.01" max="10" step="0.01" value="1"></label>
      <label><span data-t="plan_seed"></span><input id="seed" type="number" min="0" max="2147483647" step="1" value="0"></label>
      <button id="plan" class="main" data-t="do_plan"></button></fieldset>
    <fieldset><legend data-t="the_map"></legend>
      <label><span data-t="where"></span><select id="place"></select></label>
      <button id="take" type="button" data-t="take"></button>
      <div class="row"><label><span data-t="width"></span><input id="width" type="number" min="1" max="50" step="0.5" value="10"></label>
        <label><span data-t="height"></span><input id="height" type="number" min="1" max="50" step="0.5" value="8"></label></div>
      <button id="blank" type="button" data-t="blank"></button>
      <label><span data-t="files"></span><input id="files" type="file" multiple accept=".yaml,.yml,.pgm,.png,.jpg,.jpeg,.bmp,.map,.json"></label>
      <label><span data-t="resolution"></span><input id="resolution" type="number" min="0.001" max="1" step="0.001" value="0.05"></label>
    </fieldset>
    <fieldset><legend data-t="save"></legend>
      <label><span data-t="name"></span><input id="name" maxlength="60" value="my_map" autocomplete="off" spellcheck="false"></label>
      <div class="row"><button id="save-map" type="button" data-t="save_map"></button><button id="save-problem" type="button" data-t="save_problem"></button></div>
      <p id="saved"></p></fieldset>
  </form></div>`;
const TOOLS = ["start", "goal", "wall", "door", "furniture", "free", "move"];
const COLOURS = 8; // of the theme's series
const STEP = 0.1; // m that a key moves the cursor
const GRID = 0.05; // m to which points snap

export class PlanPage {
  constructor(root, looks) {
    this.looks = looks;
    this.on = build(root, HTML);
    this.view = new View(this.on.map, () => this.draw(), event => this.tool === "move" || event.button === 1);
    this.shapes = [];
    this.answers = [];
    this.tool = "start";
    this.kinds = [];
    this.fill();
    this.listen();
    this.link = new Link("plan", {
      planners: message => this.choose(message), choices: message => this.places(message), map: message => this.take(message),
      planning: message => { this.planner = message.planner; this.banner(text("planning", message)); },
      progress: state => { if (this.planner && state.kernel) this.banner(`${text("planning", { planner: this.planner })}. ${text("compile_now", state)}`); }, plan: message => this.answer(message),
      planned: () => this.planned(), growth: message => this.grow(message), saved: message => this.saved(message.files),
      error: () => { this.planner = ""; this.on.plan.disabled = false; }, lost: () => { this.on.plan.disabled = true; },
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
    this.on.tools.append(...TOOLS.map(name => {
      const label = document.createElement("label"), radio = document.createElement("input"), words = document.createElement("span");
      label.className = "check";
      radio.type = "radio"; radio.name = "tool"; radio.value = name; radio.checked = name === this.tool; radio.id = `tool-${name}`;
      radio.onchange = () => { this.tool = name; this.corner = null; this.draw(); };
      words.dataset.t = `t_${name}`;
      label.append(radio, " ", words);
      return label;
    }));
  }

  listen() {
    const on = this.on, number = (one, otherwise) => (Number.isFinite(one.valueAsNumber) ? one.valueAsNumber : otherwise);
    on.form.onsubmit = event => { event.preventDefault(); this.plan(); };
    on.take.onclick = () => { showError(""); this.link.send("place", { place: on.place.value, seed: Math.max(0, Math.trunc(number(on.seed, 0))) }); };
    on.blank.onclick = () => { showError(""); this.link.send("blank", { width: number(on.width, 10), height: number(on.height, 8) }); };
    on.files.onchange = () => this.upload([...on.files.files]);
    on.undo.onclick = () => { this.shapes.pop(); this.redraw(); };
    on.clear.onclick = () => { this.shapes = []; this.redraw(); };
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
      this[this.tool] = point;
      this.forget();
    } else if (!this.corner) {
      this.corner = this.cursor = point;
    } else {
      const kind = this.kinds.indexOf(this.tool), [x, y] = this.corner;
      if (released && Math.hypot(point[0] - x, point[1] - y) < GRID) return; // a click: the other end follows
      this.corner = null;
      this.shapes.push([kind, x, y, ...point]);
      this.redraw();
    }
    this.draw();
  }

  redraw() {
    this.on.undo.disabled = this.on.clear.disabled = !this.shapes.length;
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
    this.on.planners.replaceChildren(...message.names.map(name => {
      const label = document.createElement("label"), box = document.createElement("input");
      label.className = "check";
      box.type = "checkbox"; box.value = name; box.checked = message.first.includes(name);
      label.append(box, ` ${name}`);
      return label;
    }));
  }

  places(message) {
    this.on.place.replaceChildren(...message.places.map(([value, , name]) => new Option(name, value)));
  }

  take(message) {
    this.world = message;
    this.view.bounds = message.bounds;
    if (message.start) { this.start = message.start; this.goal = message.goal; this.shapes = []; this.on.undo.disabled = this.on.clear.disabled = true; }
    this.forget();
    this.draw();
  }

  plan() {
    const planners = [...this.on.planners.querySelectorAll("input:checked")].map(box => box.value);
    if (!planners.length) { showError(text("choose_planner")); return; }
    showError("");
    this.forget();
    this.on.plan.disabled = true;
    this.link.send("plan", {
      planners, start: this.start, goal: this.goal, clearance: this.number(this.on.clearance, 0.36),
      deadline: this.number(this.on.deadline, 1), seed: Math.max(0, Math.trunc(this.number(this.on.seed, 0))),
    });
  }

  answer(message) {
    this.answers.push(message);
    this.list();
    this.draw();
  }

  planned() {
    this.planner = "";
    this.on.plan.disabled = false;
    const solved = this.answers.filter(one => one.length !== null).sort((a, b) => a.length - b.length);
    const words = solved.length ? text("best", { planner: solved[0].planner, length: solved[0].length.toFixed(2) }) : text("no_path");
    this.banner(words);
    say(words);
  }

  list() {
    const fixed = (value, digits) => (value === null ? "–" : value.toFixed(digits));
    this.on.rows.replaceChildren(...this.answers.map((one, k) => {
      const row = document.createElement("tr"), head = document.createElement("th"), colour = document.createElement("span");
      head.scope = "row";
      colour.className = "key";
      colour.style.background = `var(--series-${k % COLOURS})`;
      head.append(colour, one.planner);
      const cells = [one.status, fixed(one.length, 2), fixed(one.clearance_min, 2), fixed(one.clearance_mean, 2), fixed(one.time_ms, 1)].map(words => {
        const cell = document.createElement("td");
        cell.textContent = words;
        return cell;
      });
      if (one.note) cells[0].title = one.note;
      const last = document.createElement("td");
      if (one.grows) {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = text("watch");
        button.setAttribute("aria-label", `${text("watch")}: ${one.planner}`);
        button.onclick = () => { this.banner(text("growing")); this.link.send("growth", { planner: one.planner }); };
        last.append(button);
      }
      row.append(head, ...cells, last);
      return row;
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
    if (Number(this.on.frame.value) >= Number(this.on.frame.max)) this.on.frame.value = 0;
    this.playing = setInterval(() => {
      this.on.frame.value = Number(this.on.frame.value) + 1;
      this.showFrame();
      if (Number(this.on.frame.value) >= Number(this.on.frame.max)) clearInterval(this.playing);
    }, 120);
  }

  showFrame() {
    const frame = this.frames[Number(this.on.frame.value)];
    if (!frame) return;
    const length = frame.length === null ? "–" : frame.length.toFixed(2);
    this.on.grown.textContent = text("grown", { planner: this.grower, iterations: frame.iterations, length });
    this.draw();
  }

  async upload(files) {
    showError("");
    for (const file of files) {
      const answer = await fetch(`maps/${encodeURIComponent(file.name)}`, { method: "POST", body: file });
      if (!answer.ok) { showError(`${file.name}: ${await answer.text()}`); return; }
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
    this.on.saved.replaceChildren(...files.flatMap(name => {
      const link = document.createElement("a");
      link.href = `files/${name}`;
      link.textContent = name;
      return [link, " "];
    }));
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
    if (this.corner) {
      const [x0, y0] = this.corner, [x1, y1] = this.cursor;
      if (this.tool === "wall" || this.tool === "door") view.line([[x0, y0], [x1, y1]], view.colour.track, 4);
      else view.polygon([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], null, view.colour.track, 3);
    }
    if (this.cursor && document.activeElement === this.on.map) {
      const [x, y] = this.cursor, r = 8 * view.pixel;
      view.segments([[x - r, y, x + r, y], [x, y - r, x, y + r]], view.colour.track, 2);
    }
    view.end();
  }
}
