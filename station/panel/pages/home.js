"use strict";
const REFRESH_MS = 2000, DUE_SOON_DAYS = 30;
const STATES = {free: t("free"), "in use": t("in use"), tripped: t("tripped"), broken: t("broken"),
                running: t("running"), evaluated: t("evaluated"), "ended without results": t("ended without results")};
const ROLES = {operator: t("operator"), engineer: t("engineer")};

const LAST = "station-last";  // what was chosen for the run before
const QUEUE = "station-serials";

function serials() { return byId("serial").value.split(/\s+/).filter(Boolean); }

function wanted() {
  return {plan: byId("plan").value, bench: byId("bench").value,
          serial: serials()[0] || "", operator: byId("operator").value};
}

// What is typed while no field has the focus belongs to the serial number.
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.key.length !== 1) return;
  if (document.activeElement.tagName === "INPUT" || (["BUTTON", "SELECT"].includes(document.activeElement.tagName) && event.key === " ")) return;
  if (!byId("content").hidden) byId("serial").select();  // what is typed now takes the place of what stood there
});

// A scanner types faster than a person and ends with Enter: what it typed is the serial number,
// whole and alone, wherever the focus was; the field it typed into gets back what stood there.
const SCAN_GAP_MS = 50, SCAN_LENGTH = 3;
let scan = {keys: "", at_ms: -Infinity};
document.addEventListener("keydown", (event) => {
  if (byId("content").hidden || event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.key.length !== 1 && event.key !== "Enter") return;
  const fast = event.timeStamp - scan.at_ms < SCAN_GAP_MS;
  if (event.key === "Enter") {
    if (fast && scan.keys.length >= SCAN_LENGTH) takeScan(event);
    scan = {keys: "", at_ms: -Infinity};
  } else {
    const field = document.activeElement;
    if (!fast) scan = {keys: "", field, before: field.value};
    scan.keys += event.key;
    scan.at_ms = event.timeStamp;
  }
}, true);

function takeScan(event) {
  event.preventDefault();
  if (scan.field.tagName === "INPUT" && scan.field.value !== scan.before) put(scan.field, scan.before);
  put(byId("serial"), scan.keys);
  byId("look-form").requestSubmit();
}

function put(field, text) {
  field.value = text;
  field.dispatchEvent(new Event("input"));
}

// What a link asks for, else what was chosen last.
function remembered() {
  const asked = Object.fromEntries(new URLSearchParams(location.search));
  return {...JSON.parse(localStorage.getItem(LAST) || "{}"), ...asked};
}

function fill(select, entries) {
  const text = JSON.stringify(entries);
  if (listed[select.id] === text) return;
  listed[select.id] = text;
  const before = select.value || remembered()[select.id] || "";
  select.replaceChildren(...entries.map((one) => new Option(one.title ? `${t(one.title)} (${one.name})` : one.name, one.name)));
  if (entries.some((one) => one.name === before)) select.value = before;
  else if (select.id === "bench" && entries.some((one) => one.name === "sim")) select.value = "sim";
}

// A list that did not change is left alone: a click, and the focus, outlive it.
const listed = {};
function list(id, entries, made) {
  const text = JSON.stringify(entries);
  if (listed[id] === text) return;
  listed[id] = text;
  byId(id).replaceChildren(...entries.map(made));
}

function benchCard(one) {
  const made = element("li", null, "bench-card " + one.state.replace(" ", "-"));
  made.append(element("h3", one.name), element("p", one.title, "muted"),
              element("p", STATES[one.state] || one.state, "state"));
  if (one.state === "in use") made.lastChild.append(": ", link(one.what, `/run/${encodeURIComponent(one.what)}`));
  else if (one.what) made.append(element("p", one.what));
  const due = one.due_days === null ? t("no calibration on record") : one.due_days < 0 ? t("calibration overdue by {days} days", {days: -one.due_days}) : t("calibration due in {days} days", {days: one.due_days});
  made.append(element("p", due, one.due_days !== null && one.due_days < DUE_SOON_DAYS ? "attention" : "muted"));
  return made;
}

function runRow(one) {
  const device = element("button", one.serial || "–");
  device.type = "button";
  device.addEventListener("click", () => showTrend(one.serial));
  return row(device, link(one.run, `/run/${encodeURIComponent(one.run)}`), STATES[one.state] || one.state,
             one.verdict ? element("span", VERDICTS[one.verdict] || one.verdict, "verdict " + one.verdict) : "");
}

// How the results of a device went from run to run.
async function showTrend(serial) {
  const response = await fetch("/api/device?serial=" + encodeURIComponent(serial));
  if (!response.ok) return;
  const data = await response.json();
  say("trend-title", t("Results of {serial}, {n} runs", {serial, n: data.runs}));
  byId("trend").replaceChildren(...data.results.map((one) => row([word(one.name), one.axis].filter(Boolean).join(" "), typeset(one.unit), trendLine(one), String(Number(one.values[one.values.length - 1].toPrecision(5))))));
  show("trend-card", true);
  byId("trend-card").scrollIntoView({block: "nearest"});
}

function trendLine({values, u, name}) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), reach = values.flatMap((v, n) => [v - (u[n] || 0), v + (u[n] || 0)]);
  const low = Math.min(...reach), high = Math.max(...reach), at = (v) => 30 - 26 * (v - low) / (high - low || 1), x = (n) => values.length > 1 ? 5 + 190 * n / (values.length - 1) : 100;
  for (const [key, value] of Object.entries({class: "trend", viewBox: "0 0 200 34", role: "img", "aria-label": t("{name}: {n} values from {low} to {high}", {name, n: values.length, low: Math.min(...values), high: Math.max(...values)})})) svg.setAttribute(key, value);
  const add = (tag, attributes) => { const made = document.createElementNS("http://www.w3.org/2000/svg", tag); for (const [k, v] of Object.entries(attributes)) made.setAttribute(k, v); svg.append(made); };
  add("polyline", {points: values.map((v, n) => `${x(n)},${at(v)}`).join(" ")});
  values.forEach((v, n) => { add("line", {x1: x(n), x2: x(n), y1: at(v - (u[n] || 0)), y2: at(v + (u[n] || 0))}); add("circle", {cx: x(n), cy: at(v), r: 3}); });
  return svg;
}

function showToday({runs, passed, plan}) {
  say("today-runs", String(runs));
  say("today-passed", String(passed));
  say("yield", plan.decided ? `${Math.round(100 * plan.passed / plan.decided)} %` : "–");
  say("yield-of", plan.decided ? t("{passed} of {decided} runs of this plan", plan) : "");
}

async function refresh() {
  try {
    const response = await fetch("/api/home?" + new URLSearchParams({search: byId("search").value, plan: byId("plan").value}));
    if (response.status === 401) { show("login", true); show("content", false); return; }
    const data = await response.json();
    show("login", false);
    const first = byId("content").hidden;
    show("content", true);
    if (first) begin();
    fill(byId("plan"), data.plans);
    fill(byId("bench"), data.benches);
    list("benches", data.benches, benchCard);
    showToday(data.today);
    list("runs", data.runs, runRow);
    say("connection", t("Role: {role}", {role: ROLES[data.role]}));
  } catch (error) {
    say("connection", t("The panel does not answer. Runs go on without it."));
  }
}

// What is asked of this visit: a serial number of the list, else an empty field that has the focus.
function begin() {
  const {operator, serial} = remembered(), queue = JSON.parse(sessionStorage.getItem(QUEUE) || "[]");
  byId("operator").value = operator || "";
  byId("serial").value = serial || queue.join(" ");
  byId("serial").select();  // a scan takes the place of what is left of a list
}

function stepItem(one, whole_s) {
  const made = element("li"), track = element("span", "", "track"), bar = element("i");
  track.style.setProperty("--from", `${100 * one.starts_s / (whole_s || 1)}%`);
  track.style.setProperty("--share", `${100 * one.expected_s / (whole_s || 1)}%`);
  track.append(bar);
  made.append(element("span", one.step), element("span", one.title), track, element("span", span(one.expected_s), "number"));
  const sets = one.set_points.map((point) => `${placeName(point.instrument)}: ${point.text}`).join("; ");
  if (sets) made.append(element("span", sets, "sets"));
  return made;
}

function extremeText(one) {
  const value = one.value === null ? one.note || t("unknown") : `${Number(one.value.toPrecision(4))} ${typeset(one.unit)}`;
  const what = t("{which} {quantity}", {which: one.which, quantity: one.quantity});
  return `${what}: ${value} (${placeName(one.instrument)})`;
}

byId("look-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  show("look", false);
  say("look-said", t("looking …"));
  byId("serial").select();  // a scan meanwhile takes the place of this one
  try {
    const looked = JSON.stringify(wanted());
    const data = await post("/api/look", wanted());
    if (looked !== JSON.stringify(wanted())) { say("look-said", t("changed meanwhile: look again")); return; }
    say("look-said", data.steps ? "" : data.faults.join("\n"));
    if (!data.steps) return;
    byId("look-faults").replaceChildren(...data.faults.map((one) => element("li", one)));
    say("look-title", `${JSON.parse(looked).serial}: ${data.title}`);
    say("look-time", t("Takes about {span} of bench time.", {span: span(data.expected_s)}));
    byId("look-steps").replaceChildren(...data.steps.map((one) => stepItem(one, data.expected_s)));
    byId("look-extremes").replaceChildren(...data.extremes.map((one) => element("li", extremeText(one))));
    byId("look-warnings").replaceChildren(...data.warnings.map((one) => element("li", one)));
    byId("start").disabled = data.faults.length > 0;
    show("look", true);
    byId("look-title").focus();  // the next scan ends with Enter, and starts nothing
  } catch (error) { say("look-said", error.message); }
});

for (const id of ["serial", "operator", "plan", "bench"]) {
  byId(id).addEventListener("input", () => show("look", false));  // what was looked at is another run
}

byId("start").addEventListener("click", async () => {
  byId("start").disabled = true;
  say("look-said", t("the run begins …"));
  const {serial, ...chosen} = wanted();
  try {
    const data = await post("/api/start", {serial, ...chosen});
    localStorage.setItem(LAST, JSON.stringify(chosen));
    sessionStorage.setItem(QUEUE, JSON.stringify(serials().slice(1)));
    location.href = `/run/${encodeURIComponent(data.run)}`;
  } catch (error) {
    say("look-said", error.message);
    byId("start").disabled = false;
  }
});

byId("login-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  try {
    await post("/login", {token: byId("token").value});
    byId("token").value = "";
    refresh();
  } catch (error) { say("login-said", error.message); }
});

byId("search").addEventListener("input", refresh);
byId("plan").addEventListener("change", refresh);
refresh();
setInterval(refresh, REFRESH_MS);
