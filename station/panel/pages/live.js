"use strict";
// What the run measures just now: tiles, interlocks, what is set and read, and the growing plots.
const OLD_S = 30;
const NEAR = 0.9;  // of its limit: from here on a value wants a person's eye
const KINDS = ["output", "field", "temperature", "angle", "rate", "current"];
const SIGNED = ["temperature", "angle"];  // whose limit is an upper one, not one of the magnitude
const MAX_TILES = 8;
const LOCK_WORDS = {clear: "✔", waits: t("! true for a moment:"), tripped: t("✘ TRIPPED:")};
const tilesShown = new Map();
let output = null, latest = {instruments: [], interlocks: []};

function readText(one) {
  const old = one.age_s > OLD_S ? t(" ({span} ago)", {span: span(one.age_s)}) : "";
  return `${word(one.quantity)} ${word(one.text)}${old}`;
}

function showLive(data) {
  latest = data;
  show("live", data.instruments.length + data.interlocks.length > 0);
  byId("live-values").replaceChildren(...data.instruments.map((one) => row(
    placeName(one.instrument), one.set || "–", one.read.map(readText).join(", ") || "–")));
  byId("interlocks").replaceChildren(...data.interlocks.map(lamp));
  const tiles = [];
  if (output) tiles.push({kind: "output", instrument: output.source, ...output, age_s: Math.max(data.time_s - output.t, 0)});
  for (const {instrument, set, read} of data.instruments) {
    for (const one of read) {
      if (one.value === undefined || !KINDS.includes(one.quantity)) continue;
      if (one.quantity !== "current" || set) tiles.push({kind: one.quantity, instrument, words: set, ...one, target: one.set});
    }
  }
  tiles.sort((a, b) => KINDS.indexOf(a.kind) - KINDS.indexOf(b.kind));
  const now = new Set(tiles.slice(0, MAX_TILES).map(showTile));
  for (const tile of tilesShown.values()) if (!now.has(tile)) notRead(tile);
}

function lamp(one) {
  const text = one.state === "clear" ? `${LOCK_WORDS.clear} ${one.name}` : `${LOCK_WORDS[one.state]} ${one.name}: ${one.said}`;
  const made = element("li", text, "lamp " + one.state);
  made.title = one.said;
  return made;
}

// A tile stays where it stands: a person learns the places.
function showTile(one) {
  const key = `${one.instrument} ${one.quantity}`;
  let tile = tilesShown.get(key);
  if (!tile) {
    tile = element("article");
    const value = element("p", "", "tile-value"), line = element("p", "", "tile-line"), near = element("div", "", "near");
    near.append(element("i"), element("b"));
    line.append(element("span"), element("span"));
    tile.append(element("h3", `${placeName(one.instrument)} · ${word(one.quantity)}`), value, line, near);
    tile.dataset.tile = key;
    tilesShown.set(key, tile);
    byId("tiles").append(tile);
  }
  const [, value, line, near] = tile.children, size = SIGNED.includes(one.kind) ? one.value : Math.abs(one.value);
  const [number, unit] = scaled(one.value, one.unit);
  value.replaceChildren(number, " ", element("small", unit));
  const set = one.target !== undefined ? t("set {value}", {value: scaled(one.target, one.unit).join(" ")}) : one.words || "";
  const old = one.age_s > OLD_S ? t("{span} ago", {span: span(one.age_s)}) : "";
  line.firstChild.textContent = [set, old].filter(Boolean).join(" · ");
  line.lastChild.textContent = one.limit === undefined ? "" : t("limit {value}", {value: scaled(one.limit, one.unit).join(" ")});
  near.hidden = one.limit === undefined;
  const share = one.limit ? Math.max(size / one.limit, 0) : 0;
  near.children[0].style.width = `${100 * Math.min(share, 1)}%`;
  near.children[1].style.left = `${100 * Math.min(Math.abs(one.target ?? 0) / Math.abs(one.limit || 1), 1)}%`;
  near.children[1].hidden = one.target === undefined;
  tile.className = "tile" + (share > 1 ? " bad" : share > NEAR ? " wait" : "") + (old ? " old" : "");
  return tile;
}

// What stands in it is the last that was heard: of a run that does not answer, of what is off.
function notRead(tile) {
  tile.className = "tile old";
  tile.children[2].firstChild.textContent = t("no newer value");
}

const COARSE = ["deg", "deg/s", "degC"];  // of what is less than a thousandth nothing is said
const PREFIXES = [[1, ""], [1e3, "m"], [1e6, "µ"], [1e9, "n"]];
function scaled(value, unit) {
  let factor = 1, prefix = "";
  if (["A", "V", "W", "s", "ohm"].includes(unit) && value !== 0) {
    [factor, prefix] = PREFIXES.find(([larger]) => Math.abs(value) * larger >= 0.1) || PREFIXES[3];
  }
  const size = Math.abs(value * factor), digits = size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : 3;
  return [size > 0 && size < 1e-3 && !COARSE.includes(unit) ? (value * factor).toExponential(1) : (value * factor).toFixed(digits).replace(/^-(0\.0+)$/, "$1"), prefix + typeset(unit)];
}

// What was commanded and what is allowed of a recorded column, where the run says so.
function levels(source, column) {
  const found = latest.instruments.find((one) => one.instrument === source);
  const read = found && found.read.find((one) => one.unit && `${one.quantity}_${one.unit}` === column);
  return {target: read && read.set, limit: read && read.limit};
}

// Plots: one below the other over one axis of time. What the device gives stands first.
function showPlots(series) {
  const shownOnes = series.filter((one) => Object.values(one.columns).some((column) => column.t.length > 1));
  const device = series.find((one) => one.device && Object.values(one.columns).some((column) => column.t.length));
  if (device) {
    const [name, column] = Object.entries(device.columns)[0];
    output = {source: device.source, quantity: name.replace(/_[^_]*$/, ""), unit: device.unit, value: column.v[column.v.length - 1], t: column.t[column.t.length - 1]};
  }
  const place = byId("plots"), data = [], count = shownOnes.length, gap = 0.08, height = (1 - gap * (count - 1)) / Math.max(count, 1);
  const style = getComputedStyle(document.documentElement), ink = style.getPropertyValue("--ink").trim(), grid = style.getPropertyValue("--line").trim();
  const size = Math.max(12, 0.75 * parseFloat(style.fontSize)), left = 5.3 * size;
  const colours = [style.getPropertyValue("--accent").trim(), ink, "#b4691f", "#7a5195"];
  const rule = (value, number, dash) => ({type: "line", xref: "paper", x0: 0, x1: 1, yref: `y${number}`, y0: value, y1: value, line: {color: ink, width: 1, dash}});
  const layout = {shapes: [], margin: {t: 1.8 * size, r: 10, b: 3 * size, l: left}, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
                  font: {color: ink, size}, showlegend: false, annotations: [], hovermode: "x", uirevision: "run", dragmode: "zoom",
                  xaxis: {title: {text: t("run time, s"), standoff: 4}, gridcolor: grid, anchor: `y${count > 1 ? count : ""}`, zeroline: false}};
  shownOnes.forEach((one, n) => {
    const number = n ? String(n + 1) : "", top = 1 - n * (height + gap);
    layout[`yaxis${number}`] = {domain: [Math.max(top - height, 0), top], title: {text: typeset(one.unit), standoff: 4}, gridcolor: grid, zeroline: false};
    const names = Object.keys(one.columns);
    layout.annotations.push({text: `${placeName(one.source)}: ${names.map((name) => word(name.replace(/_[^_]*$/, ""))).join(", ")}`, x: 0, xref: "paper", y: top, yref: "paper", xanchor: "left", yanchor: "bottom", showarrow: false, font: {size, color: ink}});
    names.forEach((name, m) => {
      const {t: times, v} = one.columns[name];
      const level = levels(one.source, name);
      if (level.target !== undefined) layout.shapes.push(rule(level.target, number, "dot"));
      for (const limit of [level.limit, -level.limit]) {  // one far away would flatten what is measured
        if (v.some((value) => value * limit > 0 && Math.abs(value) > 0.8 * Math.abs(limit))) layout.shapes.push(rule(limit, number, "dash"));
      }
      data.push({x: times.map((s) => s - (shown ? shown.began_s : 0)), y: v, name: word(name), mode: "lines", line: {width: size / 8.5, color: colours[m % colours.length]}, xaxis: "x", yaxis: `y${number}`});
    });
  });
  if (!count) return;
  Plotly.react(place, data, layout, {displaylogo: false, displayModeBar: false});
  place.dataset.plots = String(count);
  place.dataset.points = String(Math.max(...data.map((line) => line.x.length)));
  place.dataset.last = String(Math.max(...data.map((line) => line.x[line.x.length - 1] || 0)));
}

// The place changes with the header, not with the window alone.
new ResizeObserver(() => { if (byId("plots").layout) Plotly.Plots.resize(byId("plots")); }).observe(byId("plots"));
