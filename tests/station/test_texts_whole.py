"""No sentence that stands in the sources, and that a person reads, is without its translation."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from station.texts import Texts, languages

WHOLE: tuple[str, ...] = (
    "drivers/transport",
    "station/files",
    "station/record",
    "station/instruments",
    "station/roles",
    "station/dataset_checks.py",
    "station/dataset_reading.py",
    "station/dataset_tdms.py",
    "station/driver_checks.py",
    "station/registry.py",
    "station/packages.py",
    "station/fields.py",
    "station/units.py",
    "station/history",
    "station/replay",
    "station/clock",
    "station/schema",
    "station/reanalysis",
    "procedures/accelerometer_magnetic_sensitivity",
    "procedures/accelerometer_tumble",
    "procedures/commissioning",
    "procedures/common",
    "procedures/estimation",
    "procedures/fog_scale_factor_temperature",
    "procedures/gyro_bias_temperature",
    "procedures/gyro_rate_table",
    "procedures/gyro_static_noise",
    "procedures/nine_axis_calibration",
    "procedures/rlg_magnetic_sensitivity",
    "procedures/serf_nonorthogonality",
    "station/cli",
    "station/console.py",
    "station/control",
    "station/findings.py",
    "station/guardian",
    "station/method",
    "station/parts.py",
    "station/plots.py",
    "station/procedure.py",
    "station/recorded.py",
    "station/report",
    "station/results.py",
    "station/runner",
    "station/safety",
    "station/uncertainty.py",
    "station/view",
)
"""Folders and files of which every sentence is translated."""
KEPT = {
    "drivers/transport": {
        "7 in the bench file",
        "7the line broke (7)",
        "could not open visa library",
        "only 7 came and",
        "wrapper not found",
    },
    "station/clock": {
        "7 answers at once, it cannot be 7",
        "7 has the turn",
        "7 is sleeping until 7 s",
        "about to serve a request",
        "about to start",
        "in a thread that is gone",
        "nothing wakes the main thread; the process ends here",
        "take the lock 7",
        "thread 7 already takes part in time",
        "thread 7 cannot 7: it takes no part in time; enter clock.participant(...) first",
        "time stands still, every thread waits: 7",
        "waiting for 7, which 7 holds",
        "waiting for an answer of 7",
    },
    "station/dataset_reading.py": {"Python reads 1_000 as a number, nobody else does"},
    "station/fields.py": {"7.7 is in 7: end it 7"},
    "station/files/yaml": {
        "mapping values are not allowed",
        "could not find expected ':'",
        "found another document",
        "unexpected end of stream",
        "cannot start any token",
        "unknown escape character",
        "sequence entries are not allowed",
    },
    "station/history/migrations": {"UPDATE runs SET computer = host"},
    "station/history/summary.py": {"7 does not begin with 7"},
    "station/instruments": {
        "{instrument: 7, quantity: current, above: 7}",
        "- {name: 7-current, when: 7, grace: 0.4 s}",
        "7 - 7 messages are left out here: the disk was too slow",
        "Traceback (most recent call last)",
    },
    "station/record/signatures.py": {"-----BEGIN PUBLIC KEY-----.*?-----END PUBLIC KEY-----"},
    "station/roles/role.py": {
        "role 7: 7 is no Protocol",
        "role 7: 7 is no name such as zero_current",
        "role 7: 7 names no limit of it",
    },
    "station/roles/sources.py": {"Commands and their sources:"},  # a docstring's section
    "procedures/commissioning": {
        "{name: 7, 7value: 7, unit: 7, standard_uncertainty: 7}",  # a line of a bench file
    },
    "procedures/rlg_magnetic_sensitivity": {"The record with 7 driven has"},  # gaps
    "procedures/accelerometer_magnetic_sensitivity": {
        "The rows have",
        ", though the field changed",
        ", while the output moves as with the angle",
    },
    "procedures/serf_nonorthogonality": {"The records have", "7 has no fit"},
    "station/control": {"ends the prompt"},  # a thread
    "station/guardian": {
        "who holds the locks",  # a thread
        "the guardian of the run 7",  # with what became of it, each a sentence
    },
    "station/runner": {  # by which an error is known
        "annot allocate memory",
        "failed to map segment",
        "ut of memory",
        "not enough memory",
        "can't start new thread",
        "can't allocate lock",
        "without setting an exception",
        "without exception set",
        "there is no 7",  # of two programs, each with a sentence
    },
    "station/cli": {
        # Its last value is empty, or ", which is: …".
        "NOT VERIFIED: 7 could not be proven safe (7); bring it by hand to its safe state7",
    },
    "station/report": {
        '<?xml version="1.0" encoding="UTF-8"?>',
        "the run did not go through all its steps; what it measured is evaluated here",  # JUnit
    },
    "station/plots.py": {"the plot 7 is drawn; make it of panels of station.plots"},
    "procedures/gyro_bias_temperature": {"of 7, long waves left out"},
    "procedures/nine_axis_calibration": {  # calibration.json
        "output = bias + gain * force + second_order * force^2, gain = diag(scale factors) "
        "* (1 + half of the non-orthogonality, in rad)",
        "output = offset + gain * field",
    },
    "procedures": {  # columns of raw data
        "deg, the encoder of the axis that turns, turns counted, clockwise from above",
        "s, run time at which it was asked for",
    },
    "station/safety": {  # of an instrument, whose name begins the sentence
        "7 is beyond the range of the instrument, 7",
        "7 reads 7, which is no number",
    },
}
"""Sentences that nobody reads on a screen or a page, by folder: what programs read, or names.

Of several lines the first."""
IN_FILES = re.compile(r"#|import |\"\"\"")
"""How comments and programs begin, which are written into files."""
PROGRAMS = {
    "procedures/fog_scale_factor_temperature/compensation.py",
    "procedures/nine_axis_calibration/calibration.py",
    "station/cli/wrong_words.py",
}
"""Files that write programs, or know the words of another, the same in every language."""
FEWEST = 3
"""So many words make a sentence."""
IDEOGRAPH = re.compile("[\u4e00-\u9fff]")
WORD = re.compile(r"[A-Za-z]{2,}")
QUOTED = re.compile(r"`[^`]*`|'[^']*'|--?[a-z]+|\S*[._/]\S*|°C")
"""Names and commands, which are the same in every language."""
LEFT_IN_ENGLISH = re.compile(r"(?:[A-Za-z]{2,} ){2,}[A-Za-z]{2,}")
VALUE = "7"
INSTRUMENT = "turntable"
"""What may begin a sentence instead of a value."""
OF_TABLE = re.compile(r"\{(?:axis|\w+:[^{} ]+)\}")
"""A value in a sentence that a table declares."""
NEXT = re.compile(rf"(?<=\.) {VALUE}$")
"""A sentence that comes after as a value."""


def help_texts(tree: ast.AST) -> set[int]:
    """Return the texts of `--help`, which is English: help of options, of arguments, of the app."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    said = {
        id(part)
        for call in calls
        for argument in call.keywords
        if argument.arg == "help" and ast.unparse(call.func).startswith("typer.")
        for part in ast.walk(argument.value)
    }
    return said | {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]).endswith("_HELP")
        for part in ast.walk(node.value)
    }


def sentences(file: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of each sentence of a source; a value is a 7; no docstring."""
    if str(file) in PROGRAMS:
        return
    tree = ast.parse(file.read_text(encoding="utf-8"))
    parts = help_texts(tree) | {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, ast.JoinedStr | ast.Expr)
        for part in (node.values if isinstance(node, ast.JoinedStr) else (node.value,))
    }
    for node in ast.walk(tree):
        if id(node) in parts:
            continue
        if isinstance(node, ast.JoinedStr):
            text = "".join(
                str(part.value) if isinstance(part, ast.Constant) else VALUE for part in node.values
            )
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = OF_TABLE.sub(VALUE, node.value)
        else:
            continue
        if IN_FILES.match(text.strip()):
            continue
        if text.count(" ") >= FEWEST - 1 and len(WORD.findall(QUOTED.sub("", text))) >= FEWEST:
            yield node.lineno, NEXT.sub("", text.strip())


def is_whole(text: str, language: str) -> bool:
    """Return whether a sentence is translated, with no run of English words left in it."""
    said = {text, INSTRUMENT + text.removeprefix(VALUE) if text.startswith(VALUE) else text}
    return any(
        IDEOGRAPH.search(other) and not LEFT_IN_ENGLISH.search(QUOTED.sub("", other))
        for other in map(Texts(language), said)
    )


def kept_of(file: Path) -> set[str]:
    """Return the sentences of a file that nobody reads."""
    return set().union(*(texts for place, texts in KEPT.items() if str(file).startswith(place)))


def left(folder: str, language: str = "zh") -> list[str]:
    """Return the sentences of a folder or file that a language lacks, each with its place."""
    path = Path(folder)
    return [
        f"{file}:{line}: {text}"
        for file in sorted(path.rglob("*.py") if path.is_dir() else [path])
        for line, text in sentences(file)
        if text.partition("\n")[0] not in kept_of(file) and not is_whole(text, language)
    ]


@pytest.mark.parametrize("folder", WHOLE)
def test_no_sentence_of_the_sources_is_left_in_english(folder: str) -> None:
    assert {name: left(folder, name) for name in languages()[1:]} == {"zh": []}


if __name__ == "__main__":
    import sys

    print(*(text for folder in sys.argv[1:] for text in left(folder)), sep="\n")
