"use strict";
const SILENT_MS = 2500;
const RUN = decodeURIComponent(location.pathname.split("/").pop());
const API = `/api/run/${encodeURIComponent(RUN)}/`;
const ICONS = {pass: "✔", fail: "✘", inconclusive: "?", none: "–"};
const WORDS = {pass: t("PASS: within every limit"), fail: t("FAIL: the device is outside a limit"),
               inconclusive: t("INCONCLUSIVE: no decision about the device"), none: t("No limit was asked for")};
const STEP_ICONS = {done: "✔", now: "▶", waits: "·"};
const VERDICTS = {pass: t("pass"), fail: t("fail"), inconclusive: t("inconclusive"), none: t("none")};
const READS_MS = 1000;
const AGAIN_MS = 2000;
const ANSWERS_MS = 3000;
let heardMs = Date.now(), prompted = null, resultsShown = false, titleBefore = "", state = "", pausing = false, read = false, damage = "", refused = false, shown = null;

function stateOf(data) {
  shown = data;
  const alive = ["running", "paused", "evaluating"].includes(data.state);
  titleBefore = `${data.dut ? data.dut.serial : RUN}: ${t(data.sentence)}`;
  document.title = (data.prompt ? "● " : "") + titleBefore;
  say("run-title", [data.procedure, data.dut && `${data.dut.model} ${data.dut.serial}`].filter(Boolean).join(" · "));
  say("sentence", t(data.sentence));
  say("message", data.message);
  say("units", data.units_planned ? t("{done} of {planned}", {done: data.units_done, planned: data.units_planned}) : `${data.units_done}`);
  say("time", span(data.time_s));
  say("left", alive ? span(data.left_s) : t("nothing"));
  say("ends", data.ends ? new Date(data.ends * 60000).toLocaleTimeString([], {hour: "2-digit", minute: "2-digit"}) : alive ? t("unknown") : t("it has ended"));
  state = data.state;
  buttons();
  byId("steps").replaceChildren(...data.steps.map((one) => {
    const made = element("li", `${STEP_ICONS[one.state]} ${one.number} ${one.title}`, "step " + one.state);
    if (one.state === "now") made.setAttribute("aria-current", "step");
    return made;
  }));
  byId("log").replaceChildren(...data.log.slice().reverse().map((one) => element("li", `${one.t.toFixed(1)} s  ${one.text}`)));
  promptOf(data.prompt);
  safeOf(data.safe);
  const died = data.state === "interrupted";
  show("notice", died || data.state === "failed" || damage !== "");
  if (died) say("notice", t("STATION ERROR: the run's process is gone. {message}", {message: data.message}));
  if (data.state === "failed") say("notice", t("The run did not finish: {message}", {message: data.message}));
  if (damage) say("notice", damage);  // of a damaged log nobody knows how the run ended
  if (!alive && data.state === "finished" && !resultsShown) after();
}

function buttons() {
  show("pausing", pausing && state === "running");
  byId("pause").disabled = state !== "running" || pausing;
  byId("go-on").disabled = !(state === "paused" || (state === "running" && pausing));
  byId("abort").disabled = !["running", "paused"].includes(state);
}

function promptOf(prompt) {
  show("prompt", Boolean(prompt));
  if (!prompt) { prompted = null; return; }
  if (prompted && prompted.id === prompt.id && prompted.number === prompt.number) return;
  prompted = prompt;
  readable(prompt);
  say("prompt-text", prompt.text);
  say("prompt-said", "");
  say("prompt-then", prompt.then ? t("Next: {then}.", {then: prompt.then}) : "");
  show("prompt-picture", Boolean(prompt.picture));
  if (prompt.picture) {
    byId("prompt-picture").src = `${API}picture/${encodeURIComponent(prompt.picture)}`;
    byId("prompt-picture").alt = t("Drawing: {text}", {text: prompt.text});
  }
  byId("prompt-checklist").replaceChildren(...(prompt.checklist || []).map(checkbox));
  show("prompt-value-line", Boolean(prompt.value));
  byId("prompt-value").value = "";
  if (prompt.value) {
    const {name, unit, low, high} = prompt.value;
    say("prompt-value-label", t("{name}, {low} {unit} to {high} {unit}:", {name, low, high, unit}));
  }
  mayGoOn();
  byId("answer-abort").focus();  // nobody goes on by a key that was pressed before the question
  chime();
}

function checkbox(text) {
  const item = element("li"), label = element("label"), box = element("input");
  box.type = "checkbox";
  box.addEventListener("change", mayGoOn);
  label.append(box, " " + text);
  item.append(label);
  return item;
}

// The second click of a pair, or one that was meant for the prompt before, consents to nothing.
function readable(prompt) {
  read = false;
  setTimeout(() => { if (prompted === prompt) { read = true; mayGoOn(); } }, READS_MS);
}

// The run itself holds the value against its range.
function mayGoOn() {
  const boxes = [...document.querySelectorAll("#prompt-checklist input")];
  const typed = byId("prompt-value-line").hidden || byId("prompt-value").value.trim() !== "";
  byId("answer-done").disabled = !(read && typed && boxes.every((box) => box.checked));
}

function safeOf(outcomes) {
  show("safe-section", Boolean(outcomes && outcomes.length));
  byId("safe").replaceChildren(...(outcomes || []).map((one) => element(
    "li", `${one.verified ? t("✔ verified") : t("✘ NOT VERIFIED")}: ${one.instrument}: ${one.read_back}`,
    one.verified ? "good" : "bad")));
}

const LOCK_WORDS = {clear: t("✔ clear"), waits: t("! true for a moment"), tripped: t("✘ TRIPPED")};
const OLD_S = 30;

function readText(one) {
  const old = one.age_s > OLD_S ? t(" ({span} ago)", {span: span(one.age_s)}) : "";
  return `${one.quantity} ${one.text}${old}`;
}

function liveOf(data) {
  if (pausing && !data.pause_requested) say("action-said", "");
  pausing = Boolean(data.pause_requested);
  buttons();
  show("live", data.instruments.length > 0);
  byId("live-values").replaceChildren(...data.instruments.map((one) => row(
    one.instrument, one.set || "–", one.read.map(readText).join(", ") || "–")));
  byId("interlocks").replaceChildren(...data.interlocks.map((one) => element(
    "li", `${LOCK_WORDS[one.state]}: ${one.name}${one.said ? ": " + one.said : ""}`,
    one.state === "clear" ? "good" : "bad")));
}

function chime() {
  try {
    const context = new AudioContext(), tone = context.createOscillator();
    tone.connect(context.destination);
    tone.start();
    tone.stop(context.currentTime + 0.3);
  } catch (error) { /* a browser without sound shows the title */ }
}

async function after() {
  const response = await fetch(API + "results");
  if (response.status === 409) { // the folder does not vouch for them any more
    resultsShown = true;
    show("notice", true);
    say("notice", (await response.json()).error);
  }
  if (!response.ok) return;
  resultsShown = true;
  const data = await response.json();
  show("after", true);
  byId("verdict").replaceChildren(element("span", `${ICONS[data.verdict]} ${WORDS[data.verdict]}`, "verdict " + data.verdict));
  byId("results").replaceChildren(...data.results.map((one) => row(
    [one.name, one.axis].filter(Boolean).join(" "), number(one.value, one.expanded_uncertainty), number(one.expanded_uncertainty, one.expanded_uncertainty), one.unit,
    one.limit ? Object.entries(one.limit).map(([key, value]) => `${key} ${value}`).join(", ") : "",
    element("span", `${ICONS[one.verdict] || ""} ${VERDICTS[one.verdict] || one.verdict}`, "verdict " + one.verdict))));
  byId("flags").replaceChildren(...data.flags.map((one) => element("li", [one.code, one.axis, one.message].filter(Boolean).join(": "))));
  byId("report").href = API + "report";
  ownPlots();
}

// The plots of the run's procedure, as its report has them.
async function ownPlots() {
  const response = await fetch(API + "plots");
  if (!response.ok) return;
  for (const part of await response.json()) {
    const place = element("div", "", "plot");
    place.setAttribute("role", "group");
    place.setAttribute("aria-label", part.title);
    byId("own-plots").append(element("h3", part.title), element("p", part.caption), place);
    Plotly.newPlot(place, part.figure.data, part.figure.layout, {displayModeBar: false, responsive: true});
  }
}

// A value is rounded to the second digit of its expanded uncertainty.
function number(value, u) {
  if (value === null || value === undefined) return t("undetermined");
  if (!u) return String(Number(value.toPrecision(6)));
  const digits = 1 - Math.floor(Math.log10(u));
  return Math.abs(value) < 1e-4 || digits > 8 ? value.toExponential(Math.max(0, digits + Math.floor(Math.log10(Math.abs(value) || u)))) : value.toFixed(Math.max(0, digits));
}

function plotsOf(data) {
  for (const [source, columns] of Object.entries(data)) {
    const id = "plot-" + source.replace(/[^A-Za-z0-9]+/g, "-");
    let place = byId(id);
    if (!place) {
      place = element("div", "", "plot");
      place.id = id;
      place.setAttribute("role", "group");
      place.setAttribute("aria-label", t("{columns} over run time", {columns: `${source}: ${Object.keys(columns).join(", ")}`}));
      byId("plots").append(place);
    }
    const lines = Object.entries(columns).map(([name, one]) => ({x: one.t.map((s) => s - (shown ? shown.began_s : 0)), y: one.v, name, mode: "lines"}));
    const layout = {title: {text: source}, height: 260, margin: {t: 40, r: 10, b: 40, l: 70},
                    xaxis: {title: {text: t("run time, s")}}, showlegend: lines.length > 1, uirevision: source};
    Plotly.react(place, lines, layout, {displaylogo: false, responsive: true});
    place.dataset.points = String(Math.max(...lines.map((line) => line.x.length)));
    place.dataset.last = String(Math.max(...lines.map((line) => line.x[line.x.length - 1] || 0)));
  }
}

async function wish(name, data) {
  say("action-said", name === "abort" ? t("asking the run to end …") : t("asking …"));
  const silent = setTimeout(() => say("action-said",
    t("No answer yet. From a terminal: {command}", {command: `station ${name === "abort" ? "abort" : "attach"} ${RUN}`})), ANSWERS_MS);
  try {
    const word = await post(API + name, data || {});
    clearTimeout(silent);
    say("action-said", word.said || word.outcome || "");
    return word;
  } catch (error) { clearTimeout(silent); say("action-said", error.message); return {}; }
}

async function answer(text) {
  const asked = prompted;
  byId("answer-done").disabled = true;
  const word = await wish("answer", {id: asked.id, text});
  if (word.outcome === "taken" || prompted !== asked) return;
  mayGoOn();
  say("prompt-said", word.said || byId("action-said").textContent);
}

byId("pause").addEventListener("click", () => wish("pause"));
byId("go-on").addEventListener("click", () => wish("go-on"));
byId("abort").addEventListener("click", () => wish("abort"));
byId("answer-done").addEventListener("click", () => answer(
  byId("prompt-value-line").hidden ? "done" : byId("prompt-value").value));
byId("prompt-value").addEventListener("input", mayGoOn);
byId("answer-abort").addEventListener("click", () => answer("abort"));

function unreadable(data) {
  damage = data.message && t("{message}. What stands below is old or has gaps: look at the bench.", {message: data.message});
  show("notice", damage !== "");
  say("notice", damage);
  if (!damage && shown) stateOf(shown);
}

function listen() {
  const news = new EventSource(API + "events");
  for (const [name, use] of [["state", stateOf], ["live", liveOf], ["plots", plotsOf], ["unreadable", unreadable], ["beat", () => {}]]) {
    news.addEventListener(name, (event) => { heardMs = Date.now(); use(JSON.parse(event.data)); });
  }
  // A stream that was refused is not opened again by the browser.
  news.addEventListener("error", async () => {
    if (news.readyState !== EventSource.CLOSED) return;
    setTimeout(listen, AGAIN_MS);
    try { refused = (await fetch("/api/home")).status === 401; } catch (error) { /* not even that */ }
  });
}
listen();
setInterval(() => {
  const lost = Date.now() - heardMs > SILENT_MS;
  byId("connection").className = lost ? "bad" : "good";
  if (!lost) refused = false;
  say("connection", !lost ? t("connected") : t("CONNECTION LOST: what stands here is old. The run goes on without this page.")
    + (refused ? " " + t("Log in again on the first page.") : ""));
}, 500);
