// The texts of the page: one file of folder texts a language, which the server gives all at once.
const TEXTS = await (await fetch("texts.json")).json();
let current = "en";

/** Languages that the server has, and the own name of each. */
export const LANGUAGES = Object.entries(TEXTS).map(([name, texts]) => [name, texts.language_name]);

export function setLanguage(name) {
  current = name in TEXTS ? name : "en";
  document.documentElement.lang = current;
}

/** The text of a key, with values in place of {names}; the key itself where there is none. */
export function text(key, values = {}) {
  return (TEXTS[current][key] ?? key).replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");
}

/** Fill every element below a root that names its text (data-t) or its label (data-label). */
export function translate(root = document) {
  for (const one of root.querySelectorAll("[data-t]")) one.textContent = text(one.dataset.t);
  for (const one of root.querySelectorAll("[data-label]")) one.setAttribute("aria-label", text(one.dataset.label));
}
