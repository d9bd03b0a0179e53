"use strict";
// What both pages use. Everything that comes from a run is set as text, never as HTML.

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
  if (seconds === null || seconds === undefined) return "unknown";
  const whole = Math.round(seconds), h = Math.floor(whole / 3600), m = Math.floor(whole / 60) % 60;
  if (h) return `${h} h ${m} min`;
  return m ? `${m} min ${whole % 60} s` : `${whole} s`;
}

// Returns the answer's data; an error of the station, or of the network, is thrown as a sentence.
async function post(path, data) {
  let response;
  try {
    response = await fetch(path, {
      method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(data),
    });
  } catch (error) {
    throw new Error("the panel does not answer: is it still running?");
  }
  const text = await response.text();
  let found;
  try { found = JSON.parse(text); } catch (error) { found = {error: text}; }
  if (!response.ok) throw new Error(found.error || text);
  return found;
}
