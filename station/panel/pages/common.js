"use strict";
// What both pages use. Everything that comes from a run is set as text, never as HTML.

// Return an English sentence in the language of the browser; `{name}` stands for a value.
function t(text, values = {}) {
  return (TEXTS[text] ?? text).replace(/\{(\w+)\}/g, (whole, name) => values[name] ?? whole);
}

// What stands in the page's own file, before anything of a run is shown.
function translatePage() {
  document.documentElement.lang = TAG;
  const walker = document.createTreeWalker(document.documentElement, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const own = walker.currentNode.data.trim();
    if (own) walker.currentNode.data = walker.currentNode.data.replace(own, () => t(own));
  }
  for (const name of ["aria-label", "title"]) {
    for (const one of document.querySelectorAll(`[${name}]`)) one.setAttribute(name, t(one.getAttribute(name)));
  }
}

// The look: as the computer has it, or as somebody chose it for this browser.
function themeSwitch() {
  const chosen = document.createElement("select"), kept = localStorage.getItem("station-theme") || "";
  chosen.id = "theme";
  chosen.setAttribute("aria-label", t("Look of the page"));
  const dark = matchMedia("(prefers-color-scheme: dark)"), contrast = matchMedia("(prefers-contrast: more)");
  for (const [value, text] of [["", t("as the computer")], ["light", t("light")], ["dark", t("dark")], ["contrast", t("high contrast")]]) chosen.append(new Option(text, value));
  chosen.value = kept;
  const use = () => { document.documentElement.dataset.theme = chosen.value || (contrast.matches ? "contrast" : dark.matches ? "dark" : "light"); };
  chosen.addEventListener("change", () => { localStorage.setItem("station-theme", chosen.value); use(); });
  dark.addEventListener("change", use);
  use();
  document.getElementById("settings").append(chosen);
}

function languageSwitch() {
  const chosen = document.createElement("select");
  chosen.id = "language";
  chosen.setAttribute("aria-label", "Language / 语言");
  for (const one of LANGUAGES) chosen.append(new Option(new Intl.DisplayNames([one], {type: "language"}).of(one), one));
  chosen.value = LANGUAGE;
  chosen.addEventListener("change", () => {
    document.cookie = `station-language=${chosen.value}; path=/; max-age=31536000; samesite=strict`;
    location.reload();
  });
  document.getElementById("settings").append(chosen);
}
translatePage();
themeSwitch();
languageSwitch();

function byId(id) { return document.getElementById(id); }

function say(id, text) { byId(id).textContent = text; }

function show(id, shown) { byId(id).hidden = !shown; }

function element(name, text, className) {
  const made = document.createElement(name);
  if (text !== undefined && text !== null) made.textContent = text;
  if (className) made.className = className;
  return made;
}

const VERDICTS = {pass: t("pass"), fail: t("fail"), inconclusive: t("inconclusive"), none: t("none")};

// A word of an instrument: its role, a quantity, the word of a state.
function word(text) { return t(text.replace(/_/g, " ")); }

// `coil_supply.x` as people say it.
function placeName(instrument) {
  const [role, member] = instrument.split(".");
  return [word(role), member && member.replace(/_/g, " ")].filter(Boolean).join(" ");
}

const UNITS = [[/\bdegC\b/g, "°C"], [/\bdeg\b/g, "°"], [/\barcsec\b/g, "″"], [/\bohm\b/g, "Ω"], [/\bu(?=[A-Za-z])/g, "µ"], [/\^2/g, "²"], [/\^3/g, "³"], [/sqrt\((\w+)\)/g, "√$1"]];
function typeset(unit) { return UNITS.reduce((text, [ascii, sign]) => text.replace(ascii, sign), unit || ""); }

function row(...cells) {
  const made = element("tr");
  for (const cell of cells) {
    const td = element("td");
    td.append(cell instanceof Node ? cell : document.createTextNode(cell ?? ""));
    made.append(td);
  }
  return made;
}

function link(text, href) {
  const made = element("a", text);
  made.href = href;
  return made;
}

function span(seconds) {
  if (seconds === null || seconds === undefined) return t("unknown");
  const whole = Math.max(Math.round(seconds), 0), h = Math.floor(whole / 3600), m = Math.floor(whole / 60) % 60;
  if (h) return t("{h} h {m} min", {h, m});
  return m ? t("{m} min {s} s", {m, s: whole % 60}) : `${whole} s`;
}

// Returns the answer's data; an error of the station, or of the network, is thrown as a sentence.
async function post(path, data) {
  let response;
  try {
    response = await fetch(path, {
      method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(data),
    });
  } catch (error) {
    throw new Error(t("the panel does not answer: is it still running?"));
  }
  const text = await response.text();
  let found;
  try { found = JSON.parse(text); } catch (error) { found = {error: text}; }
  if (!response.ok) throw new Error(found.error || text);
  return found;
}
