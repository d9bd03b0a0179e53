"""Faults planted in datasets of every procedure end in a flag or a refusal that names them.

The tables are in `tests/support/campaigns/planted`, a module for each procedure.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from functools import cache

import pytest
from campaigns.planted.judging import (
    PROCEDURES,
    REFUSED,
    Fault,
    Row,
    broken,
    clean_makers,
    false_alarms,
    faults_of,
    judged,
    rows_of,
)
from places import ROOT

QUICK_ROWS = 1
"""So many rows of each set of codes are quick, with one seed; the others are campaign."""
ERROR_OF_A_CLEAN_DATASET_U = 4.5
HELPERS = {
    "contradiction": "contradicts-statement",
    "not_identifiable": "not-identifiable",
    "too_stiff": "model-too-stiff",
    "frozen": "frozen",
    "excitation_flags": "wrong-excitation",
    "gaps_of": "gap",
}
"""Functions of all procedures that return the flag of one code."""
NOT_PLANTED = {
    ("rlg-magnetic-sensitivity", "overload"): "only a run's gaussmeter reports it",
    ("rlg-magnetic-sensitivity", "samples-averaged"): "only of long runs: test_long_records.py",
    ("rlg-magnetic-sensitivity", "target-not-reached"): "only of a plan that stops by uncertainty",
    ("serf-nonorthogonality", "shot-repeated"): "only a run repeats a shot: test_run_serf.py",
    ("nine-axis-calibration", "field-differs-from-commanded"): "only a run commands a coil",
    ("gyro-rate-table", "misfit"): "the bias's walk takes up every contradiction that was tried",
}
"""Codes of a procedure that no imported dataset raises, and why."""
KNOWN_SILENT: dict[str, frozenset[str]] = {
    "gyro-static-noise": frozenset(
        {
            "a step of 0.1 deg/h, counts",
            "line and ramp",
        }
    ),
}
"""Faults that the data show and that yet end above 4 u without a flag, or in a library's words.

One that is mended goes; none is added."""


def planted() -> Iterator[object]:
    """Yield every row of every table with each of its seeds; slow and late ones are campaign."""
    for procedure in PROCEDURES:
        alike: Counter[frozenset[str]] = Counter()
        for row in rows_of(procedure):
            alike[row.codes] += not row.slow
            quick = not row.slow and alike[row.codes] <= QUICK_ROWS
            for number, seed in enumerate(row.seeds):
                marks = [] if quick and number == 0 else [pytest.mark.campaign]
                name = f"{procedure}: {row.name}, {seed}"
                yield pytest.param(row, seed, id=name, marks=marks)


@pytest.mark.parametrize(("row", "seed"), list(planted()))
def test_a_planted_fault_ends_as_its_row_says(row: Row, seed: int) -> None:
    assert broken(row, seed) == []


@pytest.mark.parametrize(
    ("procedure", "kind"),
    [
        pytest.param(one, kind, marks=[pytest.mark.campaign] * (kind > 0))
        for one in PROCEDURES
        for kind in range(len(clean_makers(one)))
    ],
)
def test_a_clean_dataset_raises_no_flag_of_a_fault(procedure: str, kind: int) -> None:
    false, error_u = false_alarms(procedure, clean_makers(procedure)[kind](1000 + kind))
    assert not false
    assert error_u < ERROR_OF_A_CLEAN_DATASET_U


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("procedure", "row"),
    [
        pytest.param(procedure, row, id=f"{procedure}: {row.name}")
        for procedure in PROCEDURES
        for row in rows_of(procedure)
        if row.clean is not None
    ],
)
def test_the_same_dataset_without_its_fault_raises_no_flag_of_one(procedure: str, row: Row) -> None:
    assert row.clean is not None
    false, error_u = false_alarms(procedure, row.clean(row.seeds[0]))
    assert not false
    assert error_u < ERROR_OF_A_CLEAN_DATASET_U


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("procedure", "fault"),
    [
        pytest.param(procedure, fault, id=f"{procedure}: {fault.name}")
        for procedure in PROCEDURES
        for fault in faults_of(procedure)
    ],
)
def test_no_fault_that_the_data_show_passes_unnamed(procedure: str, fault: Fault) -> None:
    known = fault.name in KNOWN_SILENT.get(procedure, ())
    found = judged(fault, 0)
    assert found["broken"] == known, "take it out of KNOWN_SILENT" if known else found


def test_every_fault_that_is_known_to_end_silent_is_planted() -> None:
    for procedure, names in KNOWN_SILENT.items():
        planted = Counter(fault.name for fault in faults_of(procedure))
        assert names <= set(planted), names - set(planted)
        assert set(planted.values()) == {1}


def flags_made(tree: ast.Module) -> Iterator[str | None]:
    """Yield the code of each flag that a module makes; None where it is no literal."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id in HELPERS:
                yield HELPERS[node.func.id]
            elif node.func.id == "Flag":
                code = node.args[0]
                yield code.value if isinstance(code, ast.Constant) else None


@cache
def modules_of(package: str) -> list[tuple[set[str | None], set[object]]]:
    """Return of each module the codes of its flags, and all its literals."""
    found = []
    for path in sorted((ROOT / "procedures" / package).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        literals = {n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)}
        found.append((set(flags_made(tree)), literals))
    return found


def test_every_flag_code_of_a_procedure_has_a_row_or_a_reason() -> None:
    packages = {one: one.replace("-", "_") for one in PROCEDURES}
    made = [codes for one in packages.values() for codes, _ in modules_of(one)]
    vocabulary = set().union(*made, HELPERS.values()) - {None}
    lacking = set()
    for procedure, package in packages.items():
        can: set[object] = set()
        for codes, literals in modules_of(package):
            # A code that is no literal is drawn from among the words of its module.
            can |= codes | (vocabulary & literals if None in codes else set())
        has = {code for row in rows_of(procedure) for code in row.codes}
        assert REFUSED in has, procedure
        lacking |= {(procedure, code) for code in can - has - {None}}
    assert lacking == set(NOT_PLANTED)
