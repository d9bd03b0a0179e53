"use strict";
const SILENT_MS = 2500;
const RUN = decodeURIComponent(location.pathname.split("/").pop());
const API = `/api/run/${encodeURIComponent(RUN)}/`;
const STATE_ICONS = {running: "▶", paused: "‖", evaluating: "⋯", finished: "■", failed: "✘", interrupted: "✘"};
const STEP_ICONS = {done: "✔", now: "▶", waits: "·"};
const READS_MS = 1000;
const AGAIN_MS = 2000;
const ANSWERS_MS = 3000;
let heardMs = performance.now(), prompted = null, resultsShown = false, titleBefore = "", state = "", pausing = false, read = false, damage = "", refused = false, shown = null, stepSeen = null;

function stateOf(data) {
  shown = data;
  const alive = ["running", "paused", "evaluating"].includes(data.state);
  titleBefore = `${data.dut ? data.dut.serial : RUN}: ${t(data.sentence)}`;
  document.title = (data.prompt ? "● " : "") + titleBefore;
  say("run-title", data.dut ? `${data.dut.model} ${data.dut.serial}` : RUN);
  say("run-procedure", data.title || data.procedure);
  byId("run-title").title = byId("run-title").textContent;
  byId("run-procedure").title = [data.title, data.procedure].filter(Boolean).join(", ");
  const waits = data.prompt || data.state === "paused", bad = ["failed", "interrupted"].includes(data.state);
  byId("pill").className = "pill" + (bad ? " bad" : waits ? " wait" : "");
  say("state-icon", data.prompt ? "?" : STATE_ICONS[data.state]);
  say("sentence", data.prompt ? t("waits for an answer") : t(data.sentence));
  say("message", data.prompt ? "" : data.message);
  byId("message").title = data.message;
  byId("bench").classList.toggle("ended", !alive);
  show("now-column", alive);
  show("measured-column", alive);
  show("after", !alive);
  say("units", data.units_planned ? t("{done} of {planned}", {done: data.units_done, planned: data.units_planned}) : `${data.units_done}`);
  say("time", span(data.time_s));
  say("left", alive ? span(data.left_s) : t("nothing"));
  say("ends", data.ends ? clock(new Date(data.ends * 60000)) : alive ? t("unknown") : t("it has ended"));
  if (state !== data.state) say("action-said", "");  // what was said of the state before
  state = data.state;
  buttons();
  showSteps(data);
  byId("log").replaceChildren(...data.log.slice().reverse().map((one) => {
    const made = element("li"), when = element("time", `${one.t.toFixed(1)} s`);
    made.append(when, element("span", one.text));
    return made;
  }));
  promptOf(data.prompt);
  safeOf(data.safe);
  const died = data.state === "interrupted";
  show("notice", died || data.state === "failed" || damage !== "");
  if (died) say("notice", t("STATION ERROR: the run's process is gone. {message}", {message: data.message}));
  if (data.state === "failed") say("notice", t("The run did not finish: {message}", {message: data.message}));
  if (damage) say("notice", damage);  // of a damaged log nobody knows how the run ended
  if (!alive) toDo(data);
  if (!alive && data.state === "finished" && !resultsShown) after();
}

// A time of day; of another day with its date.
function clock(when) {
  const day = when.toDateString() === new Date().toDateString() ? {} : {month: "2-digit", day: "2-digit"};
  return when.toLocaleString(LANGUAGE, {hour: "2-digit", minute: "2-digit", hour12: false, ...day});
}

function showSteps(data) {
  const at = data.steps.findIndex((one) => one.state === "now");
  const done = data.steps.filter((one) => one.state === "done").length;
  say("step-of", t("step {n} of {m}", {n: at < 0 ? done : at + 1, m: data.steps.length}));
  say("step-name", at < 0 ? "" : `${data.steps[at].number} ${data.steps[at].title}`);
  const gone = (one) => one.began_s === null ? 0 : data.time_s - one.began_s;
  byId("steps").replaceChildren(...data.steps.map((one) => {
    const made = element("li", null, "step " + one.state);
    const took = one.took_s !== null ? span(one.took_s) : one.state === "now" && one.expected_s ? t("{span} of {whole}", {span: span(gone(one)), whole: span(one.expected_s)}) : span(one.state === "now" ? gone(one) : one.expected_s);
    made.append(element("span", STEP_ICONS[one.state]), element("span", one.number), element("span", one.title), element("span", took, "took"));
    if (one.state === "now") made.setAttribute("aria-current", "step");
    return made;
  }));
  const now = byId("steps").querySelector("[aria-current]"), number = now && data.steps[at].number;
  if (now && number !== stepSeen) now.scrollIntoView({block: "nearest"});
  stepSeen = number;
  byId("timeline").replaceChildren(...data.steps.map((one) => {
    const part = element("span"), expected = one.expected_s || 0;
    part.style.flexGrow = String(Math.max(one.took_s ?? expected, 1));
    part.style.setProperty("--done", one.state === "done" ? "100%" : one.state === "now" ? `${Math.min(100 * gone(one) / Math.max(expected, 1), 100)}%` : "0%");
    return part;
  }));
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
  byId("prompt-title").focus();  // a key that was pressed before the question, or a scan, answers nothing
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
    "li", `${one.verified ? t("✔ verified") : t("✘ NOT VERIFIED")}: ${placeName(one.instrument)}: ${one.read_back}`,
    one.verified ? "good" : "bad")));
}

function liveOf(data) {
  if (pausing && !data.pause_requested) say("action-said", "");
  pausing = Boolean(data.pause_requested);
  buttons();
  showLive(data);
}

function chime() {
  try {
    const context = new AudioContext(), tone = context.createOscillator();
    tone.connect(context.destination);
    tone.start();
    tone.stop(context.currentTime + 0.3);
  } catch (error) { /* a browser without sound shows the title */ }
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
  for (const [name, use] of [["state", stateOf], ["live", liveOf], ["plots", showPlots], ["unreadable", unreadable], ["beat", () => {}]]) {
    news.addEventListener(name, (event) => { heardMs = performance.now(); use(JSON.parse(event.data)); });
  }
  // A stream that was refused is not opened again by the browser.
  news.addEventListener("error", async () => {
    if (news.readyState !== EventSource.CLOSED) return;
    setTimeout(listen, AGAIN_MS);
    try { refused = (await fetch("/api/home")).status === 401; } catch (error) { /* not even that */ }
  });
}
new ResizeObserver(() => document.documentElement.style.setProperty("--bar-height", `${byId("bar").offsetHeight}px`)).observe(byId("bar"));
listen();
setInterval(() => {
  const lost = performance.now() - heardMs > SILENT_MS;
  if (!lost && byId("connection").className === "bad") say("action-said", "");
  byId("connection").className = lost ? "bad" : "good";
  if (!lost) refused = false;
  say("connection", !lost ? t("connected") : t("CONNECTION LOST: what stands here is old. The run goes on without this page.")
    + (refused ? " " + t("Log in again on the first page.") : ""));
}, 500);
