"use strict";
const REFRESH_MS = 2000;
const STATES = {free: t("free"), "in use": t("in use"), tripped: t("tripped"), broken: t("broken"),
                running: t("running"), evaluated: t("evaluated"), "ended without results": t("ended without results")};
const VERDICTS = {pass: t("pass"), fail: t("fail"), inconclusive: t("inconclusive"), none: t("none")};
const ROLES = {operator: t("operator"), engineer: t("engineer")};

function wanted() {
  return {plan: byId("plan").value, bench: byId("bench").value,
          serial: byId("serial").value, operator: byId("operator").value};
}

function fill(select, entries) {
  if (select.options.length === entries.length) return;
  const chosen = select.value;
  select.replaceChildren(...entries.map((one) => new Option(one.name, one.name)));
  if (entries.some((one) => one.name === chosen)) select.value = chosen;
  else if (select.id === "bench" && entries.some((one) => one.name === "sim")) select.value = "sim";
}

function benchRow(one) {
  const word = STATES[one.state] || one.state, state = one.what ? `${word}: ${one.what}` : word;
  const due = one.due ? one.due + (one.overdue ? ` (${t("overdue")})` : "") : t("no record");
  return row(one.title ? `${one.name}: ${one.title}` : one.name, element("span", state, "state " + one.state.replace(" ", "-")), due);
}

function runRow(one) {
  return row(link(one.run, `/run/${encodeURIComponent(one.run)}`), one.serial, STATES[one.state] || one.state,
             one.verdict ? element("span", VERDICTS[one.verdict] || one.verdict, "verdict " + one.verdict) : "");
}

async function refresh() {
  try {
    const response = await fetch("/api/home?search=" + encodeURIComponent(byId("search").value));
    if (response.status === 401) { show("login", true); show("content", false); return; }
    const data = await response.json();
    show("login", false);
    show("content", true);
    fill(byId("plan"), data.plans);
    fill(byId("bench"), data.benches);
    byId("benches").replaceChildren(...data.benches.map(benchRow));
    byId("runs").replaceChildren(...data.runs.map(runRow));
    say("connection", t("Role: {role}", {role: ROLES[data.role]}));
  } catch (error) {
    say("connection", t("The panel does not answer. Runs go on without it."));
  }
}

function stepRow(one) {
  const sets = one.set_points.map((point) => `${point.instrument}: ${point.text}`).join("; ");
  return row(one.step, one.title, span(one.starts_s), sets);
}

function extremeText(one) {
  const value = one.value === null ? one.note || t("unknown") : `${Number(one.value.toPrecision(4))} ${one.unit}`;
  return `${one.which} ${one.quantity}: ${value} (${one.instrument})`;
}

byId("look-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  show("look", false);
  say("look-said", t("looking …"));
  try {
    const looked = JSON.stringify(wanted());
    const data = await post("/api/look", wanted());
    if (looked !== JSON.stringify(wanted())) { say("look-said", t("changed meanwhile: look again")); return; }
    say("look-said", data.faults.join("\n"));
    if (!data.steps) return;
    say("look-title", data.title);
    say("look-time", t("Takes about {span} of bench time.", {span: span(data.expected_s)}));
    byId("look-steps").replaceChildren(...data.steps.map(stepRow));
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
  try {
    const data = await post("/api/start", wanted());
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
refresh();
setInterval(refresh, REFRESH_MS);
