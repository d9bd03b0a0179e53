"use strict";
// What both pages use. Everything that comes from a run is set as text, never as HTML.

// Return an English sentence in the language of the browser; `{name}` stands for a value.
function t(text, values = {}) {
  return (TEXTS[text] ?? text).replace(/\{(\w+)\}/g, (whole, name) => values[name] ?? whole);
}

// What stands in the page's own file, before anything of a run is shown.
function translatePage() {
  document.documentElement.lang = LANGUAGE;
  const walker = document.createTreeWalker(document.documentElement, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const own = walker.currentNode.data.trim();
    if (own) walker.currentNode.data = walker.currentNode.data.replace(own, () => t(own));
  }
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
  document.querySelector("header").append(chosen);
}
translatePage();
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
  const whole = Math.round(seconds), h = Math.floor(whole / 3600), m = Math.floor(whole / 60) % 60;
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
