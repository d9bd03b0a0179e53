"""The result document, the run folder and the flags, held to the code."""

from __future__ import annotations

import ast
import importlib.util
import json
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

from tables import code, table

from station.decision import Limit
from station.findings import Estimate, Findings, Flag, InputQuantity, Published
from station.results import WITHHOLDING, conclude

PLACES = re.compile(r"\{[^{}]*\}")
"""Of a sentence that is declared: where its values come."""
RESULT_KEYS = {
    "schema": "version of the format",
    "procedure": "name of the procedure",
    "verdict": "`pass`, `fail`, `inconclusive`, or `none` where no limit was asked for",
    "results[]": "the best estimates, one entry for every name and axis",
    "results[].name": "name of the quantity",
    "results[].axis": "its axis, or null",
    "results[].value": "the value, null where the data do not determine it",
    "results[].unit": "unit of the value and of its uncertainties",
    "results[].standard_uncertainty": "combined standard uncertainty, types A and B",
    "results[].degrees_of_freedom": "effective degrees of freedom (Welch-Satterthwaite), "
    "null for infinitely many",
    "results[].coverage_factor": "Student's t for 95 % at these degrees of freedom",
    "results[].expanded_uncertainty": "coverage factor × standard uncertainty",
    "results[].method": "how the value was computed",
    "results[].limit": "`min`, `max` or `max_abs` of the plan in this unit, or null",
    "results[].verdict": "the decision on this value",
    "results[].decision": "only where the verdict is inconclusive: `conditional-pass`, "
    "`conditional-fail`, `undetermined`, or the flag with which nothing counts as within: "
    + ", ".join(f"`{code}`" for code in WITHHOLDING),
    "results[].budget[]": "the contributions to the standard uncertainty, largest first",
    "results[].budget[].description": "what contributes",
    "results[].budget[].type": "`A` from the data, `B` from elsewhere",
    "results[].budget[].contribution": "its standard uncertainty in the value's unit",
    "results[].budget[].source": "this measurement, a certificate of the bench file, the plan, "
    "the conditions of the dataset, or `not stated`",
    "results[].budget[].quantity": "name of the input quantity",
    "results[].budget[].value": "best estimate of the input in its unit; 0 of a deviation",
    "results[].budget[].standard_uncertainty": "that of the input, in its own unit; null where "
    "nobody states it, and the contribution is then 0",
    "results[].budget[].unit": "unit of the input",
    "results[].budget[].distribution": "what the input is distributed as: `normal`, `uniform`, "
    "`Student's t`",
    "results[].budget[].degrees_of_freedom": "those of the input, null for infinitely many",
    "results[].budget[].sensitivity": "change of the value for one unit of the input",
    "results[].budget[].share": "its part of the combined variance; all of them add to 1",
    "results[].guard_band": "where there is a limit: by how much the value must be inside it",
    "results[].conformity_probability": "where there is a limit: the probability that the quantity "
    "is within it (JCGM 106, 7.3); null with such a flag",
    "results[].monte_carlo": "only by `--monte-carlo`: what trials of the whole analysis give",
    "results[].monte_carlo.n": "how many trials",
    "results[].monte_carlo.seed": "what their random numbers are made of",
    "results[].monte_carlo.value": "mean of the trials; null where fewer than nine in ten of them "
    "give a value",
    "results[].monte_carlo.standard_uncertainty": "their standard deviation",
    "results[].monte_carlo.interval": "the symmetric interval that holds 95 % of them",
    "results[].monte_carlo.agrees": "whether its ends are those of the linear interval "
    "(JCGM 101, clause 8; see explanations/uncertainty)",
    "results[].monte_carlo.linear_value": "the value that the linear propagation holds for",
    "results[].monte_carlo.linear_expanded_uncertainty": "U by the linear propagation",
    "results[].monte_carlo.linear_inputs": "inputs that acted by their sensitivity, not through "
    "the data",
    "results[].monte_carlo.undetermined": "trials that gave no value",
    "results[].terms": "the combination that the value really is: coefficients and their shares",
    "results[].conditions": "what the value holds at, such as the temperature",
    "results[].frame": "the axes that an angle is taken from",
    "results[].field_at_device": "where the bench states `coil_geometry`: by what the measured "
    "field of the result's coil was multiplied",
    "results[].field_at_device.ratio": "mean field over the device by that at the probe",
    "results[].field_at_device.standard_uncertainty": "of the ratio",
    "results[].coil_field": "rlg-magnetic-sensitivity: the measured field of the axis's coil over "
    "the commanded one",
    "results[].coil_field.IA": "its part along IA, in phase with the coil; one or near zero",
    "results[].coil_field.NA": "its part along NA",
    "results[].coil_field.LA": "its part along LA",
    "results[].checks[]": "rlg-magnetic-sensitivity: the plan's `checks` of this axis",
    "results[].checks[].check": "which one",
    "results[].checks[].frequency_Hz": "at this frequency",
    "results[].checks[].amplitude_mT": "at this amplitude, 0 with the coils off",
    "results[].checks[].value": "the sensitivity found there; with the coils off the magnitude of "
    "the line over the plan's amplitude",
    "results[].checks[].standard_uncertainty": "its standard uncertainty, type A",
    "results[].checks[].difference": "it less the result; with the coils off the value itself",
    "results[].checks[].difference_standard_uncertainty": "of the difference, type A",
    "results[].checks[].differs": "whether the difference is more than chance makes it",
    "as_published[]": "what the source document's own formula gives on the same data",
    "as_published[].name": "name of the quantity",
    "as_published[].axis": "its axis, or null",
    "as_published[].value": "the value, null where the formula cannot run",
    "as_published[].unit": "its unit",
    "as_published[].method": "how it was computed",
    "covariance": "covariance of results where the data give it: shared inputs are in it; results "
    "that it does not name are left out, not uncorrelated",
    "covariance.names[]": "name and axis of each row",
    "covariance.matrix[]": "the rows of the matrix, in the products of the results' units",
    "flags[]": "what the reader must know; some flags have further keys, such as `count`",
    "flags[].code": "one of the [codes](flags.md)",
    "flags[].axis": "the axis it concerns, or null",
    "flags[].message": "the sentence",
    "flags[].shares": "of `cross-axis`: the field on each axis over the driven one",
    "flags[].undriven[]": "of `cross-axis`: the axes that were not driven",
    "run": "`station run --json` only: the run folder",
    "exit_code": "`station run --json` only",
    "error": "`station run --json` only: why the run did not finish, or null",
    "safe_state[]": "`station run --json` only: how each instrument came to rest",
    "safe_state[].instrument": "its instance",
    "safe_state[].verified": "whether its safe state was read back",
    "safe_state[].read_back": "what it read back",
    "safe_state[].took_s": "the time it took, in s",
    "safe_state[].used": "false for an instrument that the run did not use and that is not at rest",
    "outside[]": "`station run --json` only: how everything else on the bench that can harm was "
    "read, as in `safe_state`",
    "outside[].instrument": "its instance",
    "outside[].verified": "whether it is at rest",
    "outside[].read_back": "what it read back",
    "outside[].took_s": "the time it took, in s",
    "outside[].used": "false",
    "left_out[]": "`station run --json` only: what can harm and was not read back, why, and what "
    "is known of it",
}

RUN_FILES = {
    "plan.yaml": "the plan as it was given",
    "plan.resolved.yaml": "the plan with every default written out",
    "bench.yaml": "the bench file as it was given",
    "bench.resolved.yaml": "the bench file with every default written out",
    "run.json": "what differs from one execution to the next: UTC, host, versions, git commit, "
    "package and version of each driver of the bench, values given with `--set`",
    "events.jsonl": "the log: one JSON object a line, each with the SHA-256 of the line before",
    "raw/SOURCE-NNN.mcap": "raw rows of one source, one file for each process that wrote",
    "trace/INSTRUMENT.txt": "`run --record-wire`: every exchange of one instrument, with its time; "
    "in `segment-N/` that of a process which went on with the run",
    "trace/INSTRUMENT.sums": "Adler-32 and CRC-32 of each line of that file, in hexadecimal",
    "spectrum-AXIS.csv": "rlg-magnetic-sensitivity: the table of step S6; `IA-NA-LA` for coils "
    "driven at once",
    "results.json": "the results; a copy of revision 000",
    "plots.json": "the plots and tables of the procedure, as data; a copy of revision 000",
    "report.html": "the report; a copy of revision 000",
    "revisions/NNN/results.json": "the results of one analysis; 000 is the run's own, others begin "
    "at 001",
    "revisions/NNN/plots.json": "its plots and tables: reports in every language and format, and "
    "the panel, draw these; at most 4000 points a trace, 2 MB in all",
    "revisions/NNN/report.html": "its report",
    "revisions/NNN/manifest.json": "SHA-256 of all of them",
    "signatures/NNN.json": "a signature: the words that were signed (who, when, the SHA-256 of the "
    "log's line that says so), the signature, the public key",
    "certificates/NUMBER.pdf": "an issued certificate; its line in the log has number, date, "
    "device, customer, languages, what it replaces and why, and its SHA-256",
    "exports/RUN.h5": "the raw data as HDF5, made from the record when the run ends",
    "exports/…": "remade reports and exported data; no manifest covers them",
    "run.lock": "held while a run writes into the folder; in no manifest",
    "manifest.json": "SHA-256 of every file but itself, `exports`, `revisions`, `signatures` and "
    "`run.lock`; made anew for the log when a revision, a signature or a certificate is added",
}

RUN_EVENTS = {
    "run-started": "the plan's procedure, device and units of work; what `status` reads",
    "memory-taken": "other programs hold the memory that the evaluation will need: a warning",
    "uncalibrated": "a calibration record that the results need is not there: a warning",
    "outside-certified-range": "a calibration record states the uncertainty over another range: a "
    "warning",
    "calibration-overdue": "a calibration was due before today: a warning",
    "check-standard-alarm": "an alarm of a check standard of the bench stands: a warning, a flag",
    "history-unread": "the history could not be asked for alarms of check standards: a warning",
    "calibration-unused": "a calibration record states what the analysis does not use: a warning",
    "system-clock-unsynchronised": "nothing keeps the computer's clock right: a warning",
    "system-clock-jumped": "the computer's clock was set while the run went on; no data change",
    "identified": "an instrument answered: instance, maker, model, serial number, firmware",
    "bench-read": "how everything that can harm stood before the first step; `outside`: what the "
    "plan does not use; `left_out`: what was not read, and why",
    "witness-read": "what a gaussmeter, or another second instrument, read before anything was "
    "energised: `before` by component in `unit`, null what it does not see",
    "step-started": "a step begins: its number and title",
    "step-finished": "a step is done",
    "prompt-shown": "a person is being asked at the run's terminal, which waits for the answer",
    "prompt": "a request to the operator, the answer, and who gave it",
    "prompt-left": "a request that nothing waits for; asked once the results are written",
    "terminal-closed": "the terminal of the run is gone; the run goes on, its guardian watches it",
    "unit-started": "a unit of work begins",
    "unit-finished": "a unit of work is measured and its raw data are on disk; analysis reads "
    "finished units only; `raw_bytes` is how long the raw file of each source was then",
    "field-on": "rlg-magnetic-sensitivity: a coil was switched on, with amplitude and frequency",
    "field-off": "rlg-magnetic-sensitivity: a coil was switched off",
    "published-value": "what the source document's own formula gives while a run goes on; null "
    "where it gives nothing",
    "overload": "accelerometer-magnetic-sensitivity: the voltmeter's range was too small; the unit "
    "is measured again in the next one",
    "residual-by-modulation": "serf-nonorthogonality: what the tones of a round of nulling told",
    "residual-field": "serf-nonorthogonality: what a round of nulling found; null where it drifts",
    "depolarised": "serf-nonorthogonality: the frequency seen after the gradient, by attempt",
    "shot-repeated": "serf-nonorthogonality: a shot is fired again, and why",
    "shot-stays-bad": "serf-nonorthogonality: the last attempt of a shot was bad, too, and why",
    "pose-refused": "nine-axis-calibration: the sensor did not lie as the position asks, and why",
    "line-reopened": "a line broke, `why`, and was opened again for the same question",
    "line-resynchronised": "something came that nobody had asked for; it was thrown away",
    "answer-time": "an instrument took a larger share of the deadline of an exchange than before, "
    "and a tenth of it at least",
    "can-time-stamps": "who stamps the frames of a CAN bus: the kernel, the adapter, or the "
    "computer when it takes them",
    "frames-dropped": "a stream was not taken in time; its oldest frames were dropped",
    "switched-off-at-once": "no answer could be understood: the command to switch off was sent "
    "without a ramp, and no more than that is known of it",
    "instrument-settings": "a setting that the instrument keeps after the run, as it was met and "
    "as the run set it; it is put back at the end",
    "settings-stay": "settings that could not be put back at the end, as they were before, and why",
    "instrument-variant": "which of its several forms or firmware versions an instrument has",
    "notes-dropped": "so many notes of drivers are not in the log",
    "pause-requested": "somebody asked for a pause, and the run has come to where it may pause",
    "paused": "the run waits; `devices` has the word of each instrument that can harm",
    "pause-refused": "the run goes on; `reasons` by the name of each instrument that refused",
    "went-on": "the pause is over, and how long it took",
    "resumed": "another process resumes the run: what it found, and what has changed",
    "contact-test-started": "a person is asked to open a contact of the interlocks, `opens` by the "
    "instruments that see it; it is excused while the bench reads back as off",
    "contact-test-finished": "the test of a contact is over, and every contact was seen closed",
    "interlock-tripped": "the interlock that ended the run, what it saw, its limit, and when",
    "failed": "why the run did not finish, with its exit code and the program's traceback",
    "safe-state": "how each instrument came to rest, and whether that was read back; `outside` "
    "and `left_out` as before the run, `witnesses` what a second instrument said, `oldest_s` the "
    "age of the oldest reading then",
    "at-rest-again": "at the last look an instrument was on again, did not answer, or a witness "
    "contradicted it: it was brought to rest once more",
    "time-missed": "the run's process did not run for so many seconds; `at_s` says until when",
    "sleep-allowed": "the computer may go to sleep during the run, and why it could not be asked",
    "guardian-lost": "a guardian ended or stood still while the run went on; `at_s` says when",
    "guardian-replaced": "a new guardian is ready, `after_s` of real time later",
    "run-ended": "the end of the run; `complete` says whether every step was done",
    "revision-written": "results were computed: by the run itself (`revision` 000), or again, at "
    "`utc`, `silent_s` after the line before; `files` and `revisions` are the SHA-256 of what the "
    "manifest covers and of each revision's manifest. `t_s` is that of the line before",
    "signed": "`signer` signed with `key`, the SHA-256 of the public key; the file `signature` "
    "holds the SHA-256 of this line; the rest as in `revision-written`",
    "certificate-issued": "a certificate was issued under `number`; the rest as in "
    "`revision-written`",
}


def result_keys() -> str:
    """Return the keys of the result document."""
    return table(("key", "meaning"), [(code(key), text) for key, text in RESULT_KEYS.items()])


def result_example() -> str:
    """Return a result document that the program makes of invented numbers."""
    estimate = Estimate(
        "magnetic_sensitivity", "IA", 0.0452, "deg/h/mT", 0.0036, 98.0, "least-squares",
        {"field_gain": -0.0452},
    )  # fmt: skip
    published = Published("magnetic_sensitivity", "IA", 0.0449, "deg/h/mT", "dft-peak")
    source = "certificate 1234 of 2026-01-15"
    gain = InputQuantity("field_gain", "gaussmeter at 1 mT", 0.003, "1", source)
    flag = Flag("simulated", "The bench is simulated: these numbers say nothing of a real device.")
    findings = Findings([estimate], [published], [flag], [gain], None)
    limits = {("magnetic_sensitivity", "IA"): Limit(max_abs=0.1)}
    document = conclude("rlg-magnetic-sensitivity", findings, limits, "guarded")
    return f"```json\n{json.dumps(document.to_data(), indent=1)}\n```\n"


def run_files() -> str:
    """Return the files of a run folder."""
    return table(("file", "holds"), [(code(name), text) for name, text in RUN_FILES.items()])


def run_events() -> str:
    """Return the kinds of events."""
    return table(("event", "says"), [(code(name), text) for name, text in RUN_EVENTS.items()])


WORDED = {
    "contradiction": "contradicts-statement",
    "not_identifiable": "not-identifiable",
}
"""Functions that raise a flag, given the sentence, and its code."""


def flags() -> str:
    """Return the flags that the code raises, each with its sentence."""
    found: dict[str, list[str]] = {}
    for flag_code, sentence in sorted(raised()):
        found.setdefault(flag_code, []).append(sentence)
    rows = [(code(name), "<br>".join(dict.fromkeys(said))) for name, said in found.items()]
    return table(("code", "sentence"), rows)


@cache
def raised() -> tuple[tuple[str, str], ...]:
    """Return code and sentence of every flag that the source of the station raises."""
    specs = [importlib.util.find_spec(package) for package in ("station", "procedures")]
    folders = [folder for spec in specs if spec for folder in spec.submodule_search_locations or ()]
    paths = [path for folder in folders for path in sorted(Path(folder).rglob("*.py"))]
    return tuple(flag for path in paths for flag in flags_of(path))


def flags_of(path: Path) -> Iterator[tuple[str, str]]:
    """Yield code and sentence of the flags one file raises; an ellipsis stands for each value."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assigned = sorted(
        (
            (node.lineno, target.id, node.value)
            for node in ast.walk(tree)
            if isinstance(node, ast.Assign)
            for target in node.targets
            if isinstance(target, ast.Name)
        ),
        key=lambda one: one[0],
    )
    returned = {
        body.name: end.value
        for body in ast.walk(tree)
        if isinstance(body, ast.FunctionDef)
        for end in body.body
        if isinstance(end, ast.Return) and end.value is not None
    }
    constants = {name: value for _, name, value in assigned} | imported(tree)
    yield from chosen_by_code(tree)
    for node in ast.walk(tree):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
            continue
        if node.func.id not in {"Flag", "Cause", *WORDED} or not node.args:
            continue
        first, *others = node.args
        if node.func.id in WORDED:
            first, others = ast.Constant(WORDED[node.func.id]), node.args
        if isinstance(first, ast.Name) and first.id.isupper():
            first = constants.get(first.id, first)
        if isinstance(first, ast.Constant) and isinstance(first.value, str):
            named = {name: value for line, name, value in assigned if line <= node.lineno}
            texts = [meant(one, named, returned) for one in others]
            said = [text for text in map(sentence_of, texts) if " " in text]
            if said or first is node.args[0]:  # a literal without a sentence is missed by a test
                yield first.value, said[0] if said else ""


def imported(tree: ast.Module) -> dict[str, ast.expr]:
    """Return the texts that a file imports under names of constants."""
    texts = {
        name.name: getattr(importlib.import_module(str(node.module)), name.name, None)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("station.")
        for name in node.names
        if name.name.isupper()
    }
    return {name: ast.Constant(text) for name, text in texts.items() if isinstance(text, str)}


def chosen_by_code(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield code and sentence where a sentence is chosen by `if ….code == "CODE":`."""
    for node in ast.walk(tree):
        if not (isinstance(node, ast.If) and isinstance(node.test, ast.Compare)):
            continue
        asked, (code_asked, *_) = node.test.left, node.test.comparators
        if not (isinstance(asked, ast.Attribute) and asked.attr == "code"):
            continue
        texts = [sentence_of(one.value) for one in node.body if isinstance(one, ast.Assign)]
        said = [text for text in texts if " " in text]
        if isinstance(code_asked, ast.Constant) and said:
            yield str(code_asked.value), said[0]


def meant(
    node: ast.expr, named: Mapping[str, ast.expr], returned: Mapping[str, ast.expr]
) -> ast.expr:
    """Return what a name, or the call of a function of the same file, stands for."""
    if isinstance(node, ast.Name):
        return named.get(node.id, node)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return returned.get(node.func.id, node)
    return node


def sentence_of(node: ast.expr) -> str:
    """Return a text of the source, its values left out."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return PLACES.sub("…", node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(
            str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values
        )
    return ""
