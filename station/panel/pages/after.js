"use strict";
// What is to be seen and done once a run has ended.
const ICONS = {pass: "✔", fail: "✘", inconclusive: "?", none: "–"};
const WORDS = {pass: t("PASS: within every limit"), fail: t("FAIL: the device is outside a limit"),
               inconclusive: t("INCONCLUSIVE: no decision about the device"), none: t("No limit was asked for")};

// What a person does now; the bench first.
function toDo(data) {
  const lines = [], rest = data.rest;
  if (rest) lines.push([rest.sentence, rest.known ? "" : "bad"]);
  else lines.push([t("Nobody has read the bench back: look at it before you touch it."), "attention"]);
  if (rest && rest.known) lines.push([t("Switch the device off before you take it out."), ""]);
  else if (rest) lines.push([t("Go to the bench and switch off by hand what is on."), "bad"]);
  if (["failed", "interrupted"].includes(data.state)) lines.push([t("What was recorded is kept. Mend the cause, then resume the run."), ""]);
  byId("to-do").replaceChildren(...lines.map(([text, look]) => element("li", text, look)));
  show("resume", ["failed", "interrupted"].includes(data.state));
  const [next, ...later] = JSON.parse(sessionStorage.getItem("station-serials") || "[]");
  show("again", true);
  byId("again").href = "/?" + new URLSearchParams(data.again);
  say("again", next ? t("Next: {serial}, {n} more after it", {serial: next, n: later.length}) : t("Again for the next serial"));
}

// Once a page; again where the panel went away meanwhile.
async function after() {
  resultsShown = true;
  let response;
  try {
    response = await fetch(API + "results");
  } catch (error) {
    setTimeout(after, AGAIN_MS);
    return;
  }
  if (response.status === 409) { // the folder does not vouch for them any more
    damage = (await response.json()).error;
    show("notice", true);
    say("notice", damage);
  }
  if (!response.ok) return;
  const data = await response.json();
  show("results-card", true);
  byId("verdict").replaceChildren(element("span", `${ICONS[data.verdict]} ${WORDS[data.verdict]}`, "verdict " + data.verdict));
  byId("results").replaceChildren(...data.results.map(resultRow));
  byId("flags").replaceChildren(...data.flags.map((one) => element("li", [[one.title, one.code].filter(Boolean).join(" "), one.axis, one.message].filter(Boolean).join(": "))));
  show("report", true);
  byId("report").href = API + "report";
  show("certificate", true);
  byId("certificate").href = API + "certificate";
  ownPlots();
}

function resultRow(one) {
  const made = row([word(one.name), one.axis].filter(Boolean).join(" "), number(one.value, one.expanded_uncertainty),
    number(one.expanded_uncertainty, one.expanded_uncertainty), typeset(one.unit), limitText(one), bullet(one),
    element("span", one.verdict === "none" ? "" : `${ICONS[one.verdict] || ""} ${VERDICTS[one.verdict] || one.verdict}`, "verdict " + one.verdict));
  for (const n of [1, 2]) made.children[n].className = "number";
  return made;
}

function limitsOf({limit}) {
  if (!limit) return null;
  const most = limit.max_abs;
  return {low: most === undefined ? limit.min : -most, high: most === undefined ? limit.max : most};
}

function limitText(one) {
  const limits = limitsOf(one);
  if (!limits) return "";
  if (one.limit.max_abs !== undefined) return `|x| ≤ ${one.limit.max_abs}`;
  return [limits.low !== undefined && `≥ ${limits.low}`, limits.high !== undefined && `≤ ${limits.high}`].filter(Boolean).join(", ");
}

// The value as a mark with its expanded uncertainty, in the band of what is allowed.
function bullet(one) {
  const limits = limitsOf(one), u = one.expanded_uncertainty || 0;
  if (!limits || one.value === null) return "";
  const low = limits.low ?? Math.min(0, one.value - 2 * u), high = limits.high ?? Math.max(0, one.value + 2 * u);
  const from = Math.min(low, one.value - u), to = Math.max(high, one.value + u), edge = 0.06 * (to - from || 1);
  const at = (value) => 100 * (value - from + edge) / (to - from + 2 * edge);
  const svg = shape("svg", {class: `bullet ${one.verdict}`, viewBox: "0 0 100 16", preserveAspectRatio: "none", role: "img"});
  svg.setAttribute("aria-label", t("{value} ± {u} within {limit}", {value: number(one.value, u), u: number(u, u), limit: limitText(one)}));
  svg.append(shape("rect", {class: "outside", x: 0, y: 2, width: 100, height: 12}),
             shape("rect", {class: "within", x: at(low), y: 2, width: at(high) - at(low), height: 12}),
             shape("line", {class: "u", x1: at(one.value - u), x2: at(one.value + u), y1: 8, y2: 8, "vector-effect": "non-scaling-stroke"}),
             shape("rect", {class: "value", x: at(one.value) - 0.5, y: 1, width: 1, height: 14}));
  return svg;
}

function shape(name, attributes) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

// A value is rounded to the second digit of its expanded uncertainty.
function number(value, u) {
  if (value === null || value === undefined) return t("undetermined");
  if (!u) return String(Number(value.toPrecision(6)));
  const digits = 1 - Math.floor(Math.log10(u));
  return Math.abs(value) < 1e-4 || digits > 8 ? value.toExponential(Math.max(0, digits + Math.floor(Math.log10(Math.abs(value) || u)))) : value.toFixed(Math.max(0, digits));
}

// The plots of the run's procedure, as its report has them.
async function ownPlots() {
  const response = await fetch(API + "plots");
  if (!response.ok) return;
  show("own-plots", true);
  for (const part of await response.json()) {
    const place = element("div", "", "plot");
    place.setAttribute("role", "group");
    place.setAttribute("aria-label", part.title);
    byId("own-plots").append(element("h3", part.title), element("p", part.caption), place);
    Plotly.newPlot(place, part.figure.data, part.figure.layout, {displayModeBar: false, responsive: true});
  }
}

byId("resume").addEventListener("click", async () => {
  byId("resume").disabled = true;
  say("action-said", t("the run begins again …"));
  try {
    await post(API + "resume", {});
    location.reload();
  } catch (error) {
    say("action-said", error.message);
    byId("resume").disabled = false;
  }
});
