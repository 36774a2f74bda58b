// The page Study: consent, drives and questionnaires of an experiment, one step after another.
import { build, say, showError } from "./link.js";
import { DrivePage } from "./drive.js";
import { text, translate } from "./texts.js";

const escape = what => Object.assign(document.createElement("i"), { textContent: what }).innerHTML;
const button = (id, key) => `<div class="row"><button id="${id}" class="main" data-t="${key}"></button></div>`;
const FEW = 11; // marks that stand in one row on any screen

export class StudyPage extends DrivePage {
  constructor(root, looks) {
    super(root, looks);
    this.panel = document.createElement("section");
    this.panel.className = "panel";
    root.prepend(this.panel);
    // The same speed for everybody, and nothing that names the condition; the device is chosen before a drive.
    this.choice = [this.on.device.closest("label"), this.on.scanning];
    for (const one of [this.on.place, this.on.assist, this.on.speed]) one.closest("fieldset").remove();
    this.on.form.closest(".page").classList.add("alone");
    this.on.form.remove();
    this.on.r_shield.parentElement.remove();
    this.on.pause.remove();
    this.stage(false);
  }

  get session() { return "study"; }

  answers() {
    return {
      ...super.answers(), study: message => this.welcome(message), step: message => this.step(message),
      unfinished: () => this.unfinished(), done: () => this.done(),
    };
  }

  prepared(state) { this.ready = state.ready; }

  /** Show the world and the stick, or not. */
  stage(shown) { this.on.map.closest(".page").hidden = !shown; }

  show(html, then) {
    const found = build(this.panel, html);
    translate(this.panel);
    then?.(found);
    this.panel.querySelector("h2")?.focus();
  }

  welcome(message) {
    this.protocol = message;
    this.title = message.title;
    this.on.device.replaceChildren(...(message.devices ?? []).map(name => {
      const one = document.createElement("option");
      one.value = name; one.dataset.t = `d_${name}`;
      return one;
    }));
    if (matchMedia("(pointer: coarse)").matches && message.devices?.includes("touch")) this.on.device.value = "touch";
    if (message.scan_period) this.on.period.value = message.scan_period;
    this.ask();
  }

  ask() {
    this.stage(false);
    if (!this.title) { this.show('<p data-t="study_none"></p>'); return; }
    this.show(
      `<h2 tabindex="-1">${escape(this.title)}</h2><form id="who"><label><span data-t="participant"></span>
        <input id="number" type="number" min="1" max="9999" step="1" required></label>${button("go", "study_go")}</form>`,
      on => { on.who.onsubmit = event => {
        event.preventDefault();
        showError("");
        this.link.send("participant", { number: Math.trunc(Number(on.number.value)) });
      }; },
    );
  }

  heading(step) { return `<p class="hint">${escape(text("step_of", step))}</p>`; }

  step(step) {
    showError("");
    if (step.kind === "consent") this.consent(step);
    else if (step.kind === "drive") this.task(step);
    else this.questions(step);
  }

  consent(step) {
    this.stage(false);
    this.show(
      `${this.heading(step)}<h2 tabindex="-1" data-t="consent"></h2><p class="text">${escape(this.protocol.consent)}</p>
        <label class="check"><input type="checkbox" id="agreed"> <span data-t="agree"></span></label>${button("go", "study_go")}`,
      on => {
        on.go.disabled = true;
        on.agreed.onchange = () => { on.go.disabled = !on.agreed.checked; };
        on.go.onclick = () => this.link.send("consent");
      },
    );
  }

  task(step) {
    this.due = step;
    this.stage(false);
    this.show(
      `${this.heading(step)}<h2 tabindex="-1">${escape(step.task)}</h2>${step.practice ? '<p data-t="practice"></p>' : ""}
        <p class="text">${escape(step.task_text)}</p><p class="text">${escape(step.condition_text)}</p>
        <form id="choice"></form><p class="hint" id="how"></p>${button("go", "begin_drive")}`,
      on => {
        on.choice.append(...this.choice);
        translate(on.choice);
        this.on.how = on.how;
        this.device();
        on.go.onclick = () => this.drive();
      },
    );
  }

  /** The device of the next drive; what the protocol fixes is not asked for. */
  device() {
    super.device();
    const name = this.on.device.value, single = name === "switch";
    this.inputs.only = single ? "" : name;
    this.on.stick.hidden = name !== "touch";
    this.on.hint.hidden = name !== "keyboard";
    this.on.scanning.hidden = !single || this.protocol.scan_period > 0;
    this.choice[0].hidden = this.protocol.devices.length < 2;
    if (this.on.how) this.on.how.textContent = text(`d_how_${name}`);
  }

  drive() {
    showError("");
    this.show(`${this.heading(this.due)}<p class="text">${escape(this.due.task_text)}</p>`);
    this.stage(true);
    this.device();
    this.link.send("begin");
  }

  end(message) {
    this.running = false;
    this.result = message;
    this.buttons();
    say(text(message.outcome === "success" ? "success" : "stopped"));
  }

  unfinished() {
    this.stage(false);
    this.show(
      `${this.heading(this.due)}<h2 tabindex="-1" data-t="unfinished"></h2>
        <div class="row"><button id="repeat" class="main" data-t="again"></button><button id="leave" data-t="give_up"></button></div>`,
      on => {
        on.repeat.onclick = () => this.drive();
        on.leave.onclick = () => this.link.send("give_up");
      },
    );
  }

  questions(step) {
    this.stage(false);
    const item = ([asked, low, high, values], k) => {
      const marks = values.map(value =>
        `<label class="mark"><input type="radio" name="q${k}" value="${value}" aria-label="${value}"><span aria-hidden="true">${value}</span></label>`);
      return `<fieldset><legend>${escape(asked)}</legend><div class="ends"><span>${values[0]}: ${escape(low)}</span>
        <span>${values.at(-1)}: ${escape(high)}</span></div><div class="marks${values.length > FEW ? " many" : ""}">${marks.join("")}</div></fieldset>`;
    };
    this.show(
      `${this.heading(step)}<form id="answers"><h2 tabindex="-1">${escape(step.questionnaire === "nasa_tlx" ? "NASA-TLX" : step.questionnaire)}</h2>
        ${step.items.map(item).join("")}${button("go", "send")}</form>`,
      on => { on.answers.onsubmit = event => {
        event.preventDefault();
        const given = step.items.map((_, k) => on.answers.elements[`q${k}`].value);
        const missing = given.indexOf("");
        if (missing >= 0) {
          showError(text("unanswered"));
          on.answers.elements[`q${missing}`][0].focus();
          return;
        }
        this.link.send("answer", { values: given.map(Number) });
      }; },
    );
  }

  done() {
    this.stage(false);
    this.show(`<h2 tabindex="-1" data-t="study_done"></h2>${button("go", "next_participant")}`, on => { on.go.onclick = () => this.ask(); });
    say(text("study_done"));
  }
}
