// The frame of all pages: tabs, language, contrast, motion and text size, kept in this browser.
import { LANGUAGES, setLanguage, text, translate } from "./texts.js";
import { ComparePage } from "./compare.js";
import { DrivePage } from "./drive.js";
import { PlanPage } from "./plan.js";
import { StudyPage } from "./study.js";

const PAGES = { drive: DrivePage, plan: PlanPage, compare: ComparePage, study: StudyPage };
const allowed = await (await fetch("pages")).json(); // of this server
for (const name of Object.keys(PAGES)) if (!allowed.includes(name)) delete PAGES[name];
const by = id => document.getElementById(id);
const wants = query => matchMedia(query).matches;
const kept = () => { try { return JSON.parse(localStorage.getItem("studio") ?? "{}"); } catch { return {}; } };
const looks = {
  language: LANGUAGES.find(one => navigator.language.startsWith(one)) ?? "en", size: "100",
  contrast: wants("(prefers-contrast: more)"), still: wants("(prefers-reduced-motion: reduce)"), ...kept(),
};
let page = null;

function apply() {
  setLanguage(looks.language);
  const root = document.documentElement;
  root.className = `size-${looks.size}${looks.contrast ? " contrast" : ""}`;
  by("language").value = looks.language;
  by("size").value = looks.size;
  by("contrast").checked = looks.contrast;
  by("still").checked = looks.still;
  try { localStorage.setItem("studio", JSON.stringify(looks)); } catch { /* private windows keep nothing */ }
  translate();
  document.title = text("title");
  page?.restyle(looks);
}

function open(name) {
  page?.close();
  by("main").replaceChildren();
  by("lost").hidden = by("error").hidden = true;
  for (const tab of by("tabs").querySelectorAll("button")) {
    if (tab.dataset.page === name) tab.setAttribute("aria-current", "page");
    else tab.removeAttribute("aria-current");
  }
  page = new PAGES[name](by("main"), looks);
  window.studio = page;
  translate();
}

for (const name of Object.keys(PAGES)) {
  const item = document.createElement("li"), tab = document.createElement("button");
  tab.dataset.page = tab.dataset.t = name;
  tab.onclick = () => { location.hash = name; };
  item.append(tab);
  by("tabs").append(item);
}
by("tabs").parentElement.hidden = allowed.length < 2;
for (const id of ["language", "size"]) by(id).onchange = () => { looks[id] = by(id).value; apply(); };
for (const id of ["contrast", "still"]) by(id).onchange = () => { looks[id] = by(id).checked; apply(); };
by("again").onclick = () => open(location.hash.slice(1) in PAGES ? location.hash.slice(1) : allowed[0]);
addEventListener("hashchange", () => { if (location.hash.slice(1) in PAGES) by("again").onclick(); });
apply();
by("again").onclick();
