// The page Study: consent, drives and questionnaires of an experiment, one step after another.
import { build, by, Link, make, say, showError } from "./link.js";
import { DrivePage } from "./drive.js";
import { setLanguage, text, translate } from "./texts.js";

const escape = what => Object.assign(document.createElement("i"), { textContent: what }).innerHTML;
const button = (id, key) => `<div class="row"><button id="${id}" class="main" data-t="${key}"></button></div>`;
const BAR = '<div class="row"><button id="rest" data-t="rest"></button><button id="withdraw" data-t="withdraw"></button></div>';
const FEW = 11; // marks that stand in one row on any screen

export class StudyPage extends DrivePage {
  constructor(root, looks) {
    super(root, looks, "study");
    this.panel = make("section", { className: "panel" });
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

  get backs() { return !this.protocol.blind && super.backs; } // a blind picture tells no command

  answers() {
    return {
      ...super.answers(), study: message => this.welcome(message), step: message => this.step(message), known: message => this.known(message),
      done: message => this.done(message), lost: () => this.reconnect(),
      // A drive that is ready while the participant rests, or is asked something, waits.
      world: message => { this.begin(message); if (this.hidden) this.link.send("pause", { on: true }); },
      ended: message => { this.running = false; this.result = message; this.buttons(); },
      error: message => { if (!message.key) showError(text("not_done", message)); if (message.key === "deleted") this.ask(); else if (this.joining) this.later(() => this.join()); },
    };
  }

  close() {
    clearTimeout(this.timeout);
    by("language").closest("label").hidden = false;
    super.close();
  }

  /** Do something in a second, unless the page is left before. */
  later(act) { clearTimeout(this.timeout); this.timeout = setTimeout(act, 1000); }

  /** Connect again; what was not confirmed is then sent again. */
  reconnect() {
    this.running = this.paused = false;
    by("lost").hidden = true;
    showError(text("reconnecting"));
    this.later(() => { this.link = new Link(this.session, this.answers()); });
  }

  /** Go on with the session of this tab. */
  join() {
    this.joining = true;
    this.link.send("participant", { number: this.number, resume: true });
  }

  /** Show the world and the stick, or not. */
  stage(shown) { this.on.map.closest(".page").hidden = this.hidden = !shown; }

  /** Show a panel alone; in a step of the session, it has buttons to pause and to stop taking part. */
  show(html, then, inStep = false) {
    this.stage(false);
    const found = build(this.panel, html + (inStep ? BAR : ""));
    translate(this.panel);
    if (inStep) found.rest.onclick = () => this.rest(!this.paused);
    if (inStep) found.withdraw.onclick = () => this.withdraw();
    then?.(found);
    this.panel.querySelector("h2")?.focus();
  }

  welcome(message) {
    this.protocol = message;
    if (!this.protocol.title) { this.show('<p data-t="study_none"></p>'); return; }
    this.looks.language = message.language;
    setLanguage(message.language);
    by("language").closest("label").hidden = true;
    this.on.device.replaceChildren(...message.devices.map(name => make("option", { value: name, t: `d_${name}` })));
    translate();
    if (matchMedia("(pointer: coarse)").matches && message.devices.includes("touch")) this.on.device.value = "touch";
    if (message.scan_period) this.on.period.value = message.scan_period;
    this.on.legend.querySelector("[data-t=k_given]").parentElement.hidden = message.blind;
    this.number = Number(sessionStorage.getItem("participant"));
    if (this.number) this.join(); else this.ask();
  }

  ask() {
    this.joining = false;
    sessionStorage.clear();
    this.show(
      `<h2 tabindex="-1">${escape(this.protocol.title)}</h2><form id="who"><label><span data-t="participant"></span>
        <input id="number" type="number" min="1" max="9999" step="1" required></label>${button("go", "study_go")}</form>`,
      on => { on.who.onsubmit = event => {
        event.preventDefault();
        showError("");
        this.number = Math.trunc(Number(on.number.value));
        this.link.send("participant", { number: this.number, resume: false });
      }; },
    );
  }

  /** Ask a question with two answers. */
  decide(key, values, yes, no, then) {
    this.show(
      `<h2 tabindex="-1" class="text">${escape(text(key, values))}</h2>
        <div class="row"><button id="yes" class="main" data-t="${yes}"></button><button id="no" data-t="${no}"></button></div>`,
      on => { on.yes.onclick = () => then(true); on.no.onclick = () => then(false); },
    );
  }

  /** A number that has begun is not gone on with by mistake. */
  known(message) {
    const last = message.last.slice(0, 16).replace("T", " ");
    this.decide("known", { ...message, last }, "known_yes", "known_no", yes => { if (yes) this.join(); else this.ask(); });
  }

  rest(on) {
    this.link.send("pause", { on });
    if (!on && this.hidden && (this.running || this.waiting)) this.driving();
    if (this.running || !on) return;
    this.show(`<h2 tabindex="-1" data-t="resting"></h2>${button("go", "resume")}`, found => { found.go.onclick = () => this.rest(false); });
  }

  pausedNow(on) {
    super.pausedNow(on);
    this.panel.querySelector("#rest")?.replaceChildren(text(on ? "resume" : "rest"));
  }

  withdraw() {
    const was = this.paused;
    if (this.running && !was) this.link.send("pause", { on: true });
    this.decide("withdraw_sure", {}, "withdraw", "withdraw_no", yes => {
      if (yes) { this.link.send("withdraw"); return; }
      if (!this.running && !this.waiting) { this.step(this.due); return; }
      if (!was) this.link.send("pause", { on: false });
      this.driving();
    });
  }

  /** The place of a step, below the outcome of the drive before it. */
  heading(step) {
    const kind = step.outcome === "success" ? "good" : "alarm", words = step.outcome && escape(text(`end_${step.outcome}`));
    return `${words && `<p class="banner ${kind}">${words}</p>`}<p class="hint">${escape(text("step_of", step))}</p>`;
  }

  /** Say the outcome of a drive, and sound it: high for an arrival. */
  tell(outcome) {
    if (!outcome) return;
    say(text(`end_${outcome}`));
    this.sound ??= new AudioContext();
    const tone = new OscillatorNode(this.sound, { frequency: outcome === "success" ? 880 : 220 });
    tone.connect(new GainNode(this.sound, { gain: 0.2 })).connect(this.sound.destination);
    tone.start();
    tone.stop(this.sound.currentTime + 0.3);
  }

  step(step) {
    this.joining = this.running = this.paused = this.waiting = false;
    this.due = step;
    sessionStorage.setItem("participant", this.number);
    if (this.kept()?.step !== step.number) sessionStorage.removeItem("answers");
    showError("");
    this.tell(step.outcome);
    if (step.kind === "consent") this.consent(step);
    else if (step.kind === "drive") this.task(step);
    else this.questions(step);
    step.outcome = "";
  }

  consent(step) {
    this.show(
      `${this.heading(step)}<h2 tabindex="-1" data-t="consent"></h2><p class="text">${escape(this.protocol.consent)}</p>
        <label class="check"><input type="checkbox" id="agreed"> <span data-t="agree"></span></label>${button("go", "study_go")}`,
      on => {
        on.go.disabled = true;
        on.agreed.onchange = () => { on.go.disabled = !on.agreed.checked; };
        on.go.onclick = () => this.link.send("consent", { step: step.number });
      }, true,
    );
  }

  task(step) {
    this.show(
      `${this.heading(step)}<h2 tabindex="-1">${escape(step.task)}</h2>${step.practice ? '<p data-t="practice"></p>' : ""}
        ${step.text.map(one => `<p class="text">${escape(one)}</p>`).join("")}
        <form id="choice"></form><p class="hint" id="how"></p>${button("go", "begin_drive")}`,
      on => {
        on.choice.append(...this.choice);
        translate(on.choice);
        this.on.how = on.how;
        this.device();
        on.go.onclick = () => this.drive();
      }, true,
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
    this.driving();
    this.device();
    this.link.send("begin");
  }

  /** Show the drive that is under way, or is made ready. */
  driving() {
    this.show(`${this.heading(this.due)}<p class="text">${escape(this.due.text[0])}</p>`, null, true);
    this.stage(true);
    this.pausedNow(this.paused);
  }

  /** Answers of this tab that the server has not confirmed: step, values, and whether they were sent. */
  kept() { return JSON.parse(sessionStorage.getItem("answers")); }

  questions(step) {
    const tlx = step.questionnaire === "nasa_tlx", words = what => escape(tlx ? text(what) : what), kept = this.kept();
    const item = ([asked, low, high, values], k) => {
      const marks = values.map(value =>
        `<label class="mark"><input type="radio" name="q${k}" value="${value}" aria-label="${value}"><span aria-hidden="true">${value}</span></label>`);
      return `<fieldset><legend>${words(asked)}</legend><div class="ends"><span>${values[0]}: ${words(low)}</span>
        <span>${values.at(-1)}: ${words(high)}</span></div><div class="marks${values.length > FEW ? " many" : ""}">${marks.join("")}</div></fieldset>`;
    };
    this.show(
      `${this.heading(step)}<form id="answers"><h2 tabindex="-1">${escape(tlx ? "NASA-TLX" : step.questionnaire)}</h2>
        ${step.items.map(item).join("")}${button("go", "send")}</form>`,
      on => {
        const given = () => step.items.map((_, k) => on.answers.elements[`q${k}`].value);
        const keep = sent => sessionStorage.setItem("answers", JSON.stringify({ step: step.number, values: given(), sent }));
        const send = () => this.link.send("answer", { values: given().map(Number), step: step.number });
        kept?.values.forEach((value, k) => { on.answers.elements[`q${k}`].value = value; });
        on.answers.onchange = () => keep(false);
        on.answers.onsubmit = event => {
          event.preventDefault();
          const missing = given().indexOf("");
          if (missing >= 0) {
            showError(text("unanswered"));
            on.answers.elements[`q${missing}`][0].focus();
            return;
          }
          keep(true);
          send();
        };
        if (kept?.sent) send();
      }, true,
    );
  }

  done(message) {
    sessionStorage.clear();
    this.joining = this.running = false;
    this.tell(message.outcome);
    this.show(`<h2 tabindex="-1" data-t="${message.text}"></h2>${button("go", "next_participant")}`, on => { on.go.onclick = () => this.ask(); });
    say(text(message.text));
  }
}
