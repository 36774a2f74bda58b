// The frame of all pages: tabs, language, contrast, motion and text size, kept in this browser.
import { LANGUAGES, setLanguage, text, translate } from "./texts.js";
import { ComparePage } from "./compare.js";
import { DrivePage } from "./drive.js";
import { build, by, make } from "./link.js";
import { PlanPage } from "./plan.js";
import { StudyPage } from "./study.js";

/** What there is to do, for somebody who is here for the first time. */
function WelcomePage(root) { build(root, by("welcome-page").innerHTML); }

const PAGES = { welcome: WelcomePage, drive: DrivePage, plan: PlanPage, compare: ComparePage, study: StudyPage };
const allowed = await (await fetch("pages")).json(); // of this server
for (const name of Object.keys(PAGES)) if (!allowed.includes(name === "welcome" ? "drive" : name)) delete PAGES[name];
const wants = query => matchMedia(query).matches;
const kept = () => { try { return JSON.parse(localStorage.getItem("studio") ?? "{}"); } catch { return {}; } };
const looks = {
  language: LANGUAGES.find(([name]) => navigator.language.startsWith(name))?.[0] ?? "en", size: "100",
  contrast: wants("(prefers-contrast: more)"), still: wants("(prefers-reduced-motion: reduce)"), ...kept(),
};
let page = null;

function keep() {
  try { localStorage.setItem("studio", JSON.stringify(looks)); } catch { /* private windows keep nothing */ }
}

function apply() {
  setLanguage(looks.language);
  const root = document.documentElement;
  root.className = `size-${looks.size}${looks.contrast ? " contrast" : ""}`;
  by("language").value = looks.language;
  by("size").value = looks.size;
  by("contrast").checked = looks.contrast;
  by("still").checked = looks.still;
  keep();
  translate();
  document.title = text("title");
  page?.restyle?.(looks);
}

function open(name) {
  page?.close?.();
  by("main").replaceChildren();
  by("lost").hidden = by("error").hidden = true;
  for (const tab of by("tabs").querySelectorAll("button")) {
    if (tab.dataset.page === name) tab.setAttribute("aria-current", "page");
    else tab.removeAttribute("aria-current");
  }
  page = new PAGES[name](by("main"), looks);
  looks.known ||= name !== "welcome";
  keep();
  window.studio = page;
  translate();
}

for (const name of Object.keys(PAGES)) {
  const tab = make("button", { t: name, onclick: () => { location.hash = name; } });
  tab.dataset.page = name;
  by("tabs").append(make("li", {}, tab));
}
by("tabs").parentElement.hidden = allowed.length < 2;
by("language").append(...LANGUAGES.map(([name, own]) => new Option(own, name)));
for (const id of ["language", "size"]) by(id).onchange = () => { looks[id] = by(id).value; apply(); };
for (const id of ["contrast", "still"]) by(id).onchange = () => { looks[id] = by(id).checked; apply(); };
matchMedia("(prefers-color-scheme: dark)").onchange = apply;
by("again").onclick = () => {
  const asked = location.hash.slice(1), first = looks.known ? allowed[0] : Object.keys(PAGES)[0];
  open(asked in PAGES ? asked : first);
};
addEventListener("hashchange", () => { if (location.hash.slice(1) in PAGES) by("again").onclick(); });
apply();
by("again").onclick();
