"""What a planted fault is, and how a dataset that has it is judged: one judge for every table."""

from __future__ import annotations

import importlib
import json
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from places import DATA

from station.dataset_reading import read_dataset
from station.errors import EXIT_WRONG_INPUT, InputError
from station.runner.evaluation import evaluate_dataset

Array = NDArray[Any]
Key = tuple[str, str | None, str | None]

PROCEDURES = {
    "accelerometer-magnetic-sensitivity": "accelerometer",
    "accelerometer-tumble": "tumble",
    "fog-scale-factor-temperature": "fog",
    "gyro-bias-temperature": "bias_temperature",
    "gyro-rate-table": "rate_table",
    "gyro-static-noise": "static_noise",
    "nine-axis-calibration": "nine_axis",
    "rlg-magnetic-sensitivity": "rlg",
    "serf-nonorthogonality": "serf",
}
"""The module of each procedure's tables."""
REFUSED = "refused"
"""Stands among the flags for an import that ends without results."""
SENTENCE = re.compile(r"\S+\.(yaml|csv):\d+:\d+: \S+: .{8,}|and \d+ more faults")
"""What each line of a refusal is: file, line, column, key, what is wrong."""
SILENT_ABOVE_U = 4.0
FOUND_ABOVE = 4.65
"""Where a test with 1 % of false alarms detects 99 %: twice the 99 % point of a normal deviate."""


@dataclass(frozen=True)
class Seen:
    """What an analysis says: flags as the contract writes them, the largest error of a result.

    The error is in standard uncertainties, `worst` the result that has it; `valued` are the results
    with a value, as `name` and as `name/axis`.
    """

    flags: Sequence[Mapping[str, Any]]
    error_u: float
    valued: frozenset[str] = frozenset()
    worst: str = ""

    @property
    def codes(self) -> frozenset[str]:
        """The codes of the flags."""
        return frozenset(flag["code"] for flag in self.flags)


class Sample(Protocol):
    """Something that can be analysed."""

    def seen(self) -> Seen:
        """Analyse it."""
        ...


@dataclass(frozen=True)
class Made:
    """One dataset that is written as a folder, and what is true of it.

    `truth` maps (name, axis, at) of results to values, `write` puts the dataset into a folder.
    `data` (n,) are its readings in one order, `model` (n, p) their derivatives by everything that
    a clean dataset leaves free, `noise` (n,) their standard deviations. `further_error_u` returns
    the largest error, in standard uncertainties, of what a result holds beside its value.
    """

    truth: Mapping[Key, float]
    write: Callable[[Path], None]
    data: Array
    model: Array
    noise: Array
    further_error_u: Callable[[Sequence[Mapping[str, Any]]], float] | None = None

    def seen(self) -> Seen:
        """Analyse the folder."""
        document = analysed(self)
        worst, error_u = worst_of(self, document["results"])
        return replace(seen_of(document, error_u), worst=worst)


@dataclass(frozen=True)
class Held:
    """A dataset in memory, what analyses it, and what finds the largest error in the analysis."""

    dataset: Any
    analyse: Callable[[Any], Any]
    off_u: Callable[[Any], float]

    def but(self, change: Callable[[Any], Any]) -> Held:
        """Return it with its dataset changed."""
        return replace(self, dataset=change(self.dataset))

    def seen(self) -> Seen:
        """Analyse the dataset."""
        analysis = self.analyse(self.dataset)
        flags = [flag.to_data() for flag in analysis.flags]
        valued = ((one.name, one.axis) for one in analysis.estimates if one.value is not None)
        return Seen(flags, self.off_u(analysis), names_of(valued))


@dataclass(frozen=True)
class Written:
    """A folder whose files are given as text; `truth` maps results to values and tolerances."""

    files: Mapping[str, str]
    truth: Mapping[tuple[str, str | None], tuple[float, float]] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Put the files into a folder."""
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding="utf-8")

    def but(self, file: str, change: Callable[[str], str]) -> Written:
        """Return it with a file changed, which must make a difference."""
        text = change(self.files[file])
        assert text != self.files[file], f"{file} stays as it is"
        return replace(self, files={**self.files, file: text})

    def seen(self) -> Seen:
        """Analyse the folder; the error is the largest one in tolerances."""
        document = analysed(self)
        off = (
            abs(one["value"] - value) / tolerance
            for one in document["results"]
            for value, tolerance in [self.truth.get((one["name"], one["axis"]), (0.0, np.inf))]
            if one["value"] is not None
        )
        return seen_of(document, max(off, default=0.0))


@dataclass(frozen=True)
class Fault:
    """A fault planted in a dataset that is written as a folder.

    `clean` and `planted` make the same dataset of a seed, without and with it. `flags` are the
    codes of which any names its cause; where `usual` are given, the codes that a clean dataset may
    raise, any other one does. `detectable` says so where rows differ and nothing can be compared.
    """

    name: str
    flags: frozenset[str]
    clean: Callable[[int], Made]
    planted: Callable[[int], Made]
    detectable: bool | None = None
    details: Mapping[str, Any] = field(default_factory=dict)
    usual: frozenset[str] | None = None

    def named_by(self, codes: frozenset[str]) -> bool:
        """Whether any of the codes names its cause."""
        return bool(self.flags & codes if self.usual is None else codes - self.usual)


@dataclass(frozen=True)
class Row:
    """What a dataset of some seeds must end in.

    All of `codes` must be raised, none of `without`, and no others than `others` where that is not
    None. Each of `says` must stand in the message of a flag of `codes`, or in the refusal; one such
    flag must have all `details`, a number as (value, tolerance). The largest error is known and
    stays below `below_u`; of `null` no result has a value, the name `*` being all of them, and each
    of `known` has one. `clean` makes the same dataset without the fault. `slow` rows are campaign.
    """

    name: str
    make: Callable[[int], Sample]
    codes: frozenset[str]
    seeds: Sequence[int] = (0,)
    without: frozenset[str] = frozenset()
    says: Sequence[str] = ()
    details: Mapping[str, Any] = field(default_factory=dict)
    below_u: float | None = None
    others: frozenset[str] | None = None
    null: frozenset[str] = frozenset()
    known: frozenset[str] = frozenset()
    clean: Callable[[int], Sample] | None = None
    slow: bool = False


def row(
    name: str,
    make: Callable[[int], Sample],
    codes: str = "",
    *,
    says: str | Sequence[str] = (),
    without: str = "",
    null: str = "",
    known: str = "",
    others: str | frozenset[str] | None = None,
    **more: Any,
) -> Row:
    """Return a row, its codes and names given as one text."""
    beside = frozenset(others.split()) if isinstance(others, str) else others
    words = (says,) if isinstance(says, str) else says
    parts = (frozenset(text.split()) for text in (codes, without, null, known))
    needed, never, empty, full = parts
    return Row(
        name,
        make,
        needed,
        without=never,
        says=words,
        null=empty,
        known=full,
        others=beside,
        **more,
    )


def refusals(sample: Written, *lines: tuple[str, str, str, str]) -> Iterator[Row]:
    """Yield the rows of texts that are replaced: file, what, by what, what the refusal says."""
    for file, old, new, said in lines:
        changed = sample.but(file, lambda text, old=old, new=new: text.replace(old, new, 1))  # type: ignore[misc]
        name = f"refused, {file}: {old.strip()} becomes {new.strip() or 'nothing'}"
        yield row(name, lambda _, one=changed: one, REFUSED, says=said)  # type: ignore[misc]


def by_rows(change: Callable[[list[str]], list[str] | None]) -> Callable[[str], str]:
    """Return the change of a table of which each row's cells are changed, or left out."""

    def changed(text: str) -> str:
        head, *lines = text.splitlines()
        cells = (change(line.split(",")) for line in lines)
        return "\n".join([head, *(",".join(one) for one in cells if one)]) + "\n"

    return changed


@cache
def example(name: str) -> Written:
    """Return an example dataset, with the values and tolerances that come with it."""
    folder = DATA / name
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    names = [path.name for path in folder.iterdir() if path.suffix in (".csv", ".yaml")]
    expected = truth.get("expected", ())
    return Written(
        {one: (folder / one).read_text(encoding="utf-8") for one in names},
        {(one["name"], one.get("axis")): (one["value"], one["tolerance"]) for one in expected},
    )


def of_fault(faults: Sequence[Fault], name: str, seed: int, codes: str, **more: Any) -> Row:
    """Return the row of a fault of a long table; `codes` of its flags must be raised."""
    (fault,) = (one for one in faults if one.name == name)
    return row(name, fault.planted, codes, seeds=(seed,), clean=fault.clean, **more)


def but(make: Callable[[int], Held], change: Callable[[Any, int], Any]) -> Callable[[int], Held]:
    """Return the maker of a dataset in memory that is changed; the change is given the seed."""
    return lambda seed: make(seed).but(lambda dataset: change(dataset, seed))


def analysed(sample: Made | Written) -> dict[str, Any]:
    """Return the results of a dataset as the contract writes them; none where it is refused."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "dataset"
        folder.mkdir()
        sample.write(folder)
        try:
            document, _ = evaluate_dataset(read_dataset(folder))
        except InputError as refusal:
            assert refusal.exit_code == EXIT_WRONG_INPUT
            return {"results": [], "flags": [{"code": REFUSED, "message": str(refusal)}]}
        return document.to_data()


def seen_of(document: Mapping[str, Any], error: float) -> Seen:
    """Return what a document says."""
    results = document["results"]
    valued = ((one["name"], one["axis"]) for one in results if one["value"] is not None)
    return Seen(document["flags"], error, names_of(valued))


def names_of(results: Iterable[tuple[str, str | None]]) -> frozenset[str]:
    """Return results as `name` and as `name/axis`."""
    return frozenset(text for name, axis in results for text in (name, f"{name}/{axis}"))


def worst_of(made: Made, results: Sequence[Mapping[str, Any]]) -> tuple[str, float]:
    """Return the result with the largest error and it in standard uncertainties, 0 of none."""
    name, worst = "", 0.0 if made.further_error_u is None else made.further_error_u(results)
    for one in results:
        key = (one["name"], one.get("axis"), one.get("at"))
        if one["value"] is None or key not in made.truth:
            continue
        off, u = abs(one["value"] - made.truth[key]), one["standard_uncertainty"]
        error = float(off / u) if u else float("inf") if off else 0.0
        if error > worst:
            name, worst = "/".join(filter(None, key)), error
    return name, worst


def deviates(clean: Made, planted: Made) -> float:
    """Return how many standard deviations a test that knows the cause sees in the data.

    It is the norm of what the fault changes, weighted, less all that a free parameter can take up.
    """
    weight = 1.0 / clean.noise
    change = (planted.data - clean.data) * weight
    model = clean.model * weight[:, None]
    taken, *_ = np.linalg.lstsq(model, change, rcond=None)
    return float(np.linalg.norm(change - model @ taken))


def judged(fault: Fault, seed: int) -> dict[str, Any]:
    """Plant a fault of a long table and return what followed.

    `error_u` is the largest error of a result, `shown` whether the data can show the fault: a test
    that knows its cause detects it in 99 % of such data and the error is above 4 u. `silent` is an
    error above 4 u that no flag names, `broken` one of a fault that the data can show, or a refusal
    that is no sentence of ours.
    """
    clean, planted = fault.clean(seed), fault.planted(seed)
    seen = planted.seen()
    strength = None if fault.detectable is not None else deviates(clean, planted)
    detectable = fault.detectable if strength is None else strength > FOUND_ABOVE
    named = fault.named_by(seen.codes)
    shown = bool(detectable) and seen.error_u > SILENT_ABOVE_U
    return {
        "benchmark": "sabotage",
        "fault": fault.name,
        "seed": seed,
        "error_u": round(seen.error_u, 2),
        "worst": seen.worst,
        "deviates": None if strength is None else round(strength, 1),
        "shown": shown,
        "named": named,
        "flags": sorted(seen.codes),
        "silent": seen.error_u > SILENT_ABOVE_U and not named,
        "broken": (shown and not named) or not in_words(seen.flags),
        **fault.details,
    }


@cache
def _module(procedure: str) -> Any:
    return importlib.import_module(f"campaigns.planted.{PROCEDURES[procedure]}")


def rows_of(procedure: str) -> Sequence[Row]:
    """Return the faults of a procedure whose flags or refusals are known."""
    rows: Sequence[Row] = _module(procedure).ROWS
    return rows


def faults_of(procedure: str) -> Sequence[Fault]:
    """Return the long table of a procedure; empty where it has none."""
    faults: Sequence[Fault] = getattr(_module(procedure), "FAULTS", ())
    return faults


def usual_flags(procedure: str) -> frozenset[str]:
    """Return the codes that a clean dataset may raise."""
    usual: frozenset[str] = _module(procedure).USUAL_FLAGS
    return usual


def clean_makers(procedure: str) -> Sequence[Callable[[int], Sample]]:
    """Return what makes each kind of clean dataset of a procedure."""
    makers: Sequence[Callable[[int], Sample]] = _module(procedure).CLEAN
    return makers


def broken(row: Row, seed: int) -> list[str]:
    """Return the promises of a row that a dataset of a seed does not keep."""
    seen = row.make(seed).seen()
    flags = [one for one in seen.flags if one["code"] in row.codes]
    messages = [str(one["message"]) for one in flags]
    failures = [f"{code} is not raised" for code in sorted(row.codes - seen.codes)]
    failures += [f"{code} is raised" for code in sorted(row.without & seen.codes)]
    if row.others is not None:
        beside = seen.codes - row.codes - row.others
        failures += [f"{code} is raised beside it" for code in sorted(beside)]
    if row.details and not any(has_details(one, row.details) for one in flags):
        failures.append(f"no flag has {row.details}, but {flags}")
    failures += [
        f"nothing says '{text}'" for text in row.says if not any(text in m for m in messages)
    ]
    if REFUSED in row.codes and not in_words(flags):
        failures.append(f"{messages} is no sentence")
    if row.below_u is not None and not (0.0 < seen.error_u < row.below_u or not seen.valued):
        failures.append(f"a result is {seen.error_u:.1f} u off")
    valued = seen.valued if "*" in row.null else seen.valued & row.null
    failures += [f"{name} has a value" for name in sorted(valued)]
    failures += [f"{name} has no value" for name in sorted(row.known - seen.valued)]
    return [*failures, f"flags {sorted(seen.codes)}: {messages}"] if failures else []


def in_words(flags: Sequence[Mapping[str, Any]]) -> bool:
    """Whether every line of a refusal is a sentence about a place in the dataset."""
    messages = (flag["message"] for flag in flags if flag["code"] == REFUSED)
    return all(SENTENCE.fullmatch(line) for text in messages for line in text.splitlines())


def has_details(flag: Mapping[str, Any], details: Mapping[str, Any]) -> bool:
    """Whether a flag has details; a number is given as (value, tolerance)."""
    return all(
        name in flag
        and (
            abs(flag[name] - expected[0]) <= expected[1]
            if isinstance(expected, tuple)
            else flag[name] == expected
        )
        for name, expected in details.items()
    )


def false_alarms(procedure: str, sample: Sample) -> tuple[frozenset[str], float]:
    """Return the unusual flags of a clean dataset, and the largest error of a result."""
    seen = sample.seen()
    return seen.codes - usual_flags(procedure), seen.error_u


def clean_runs(procedure: str, count: int, first: int = 1000) -> Iterator[dict[str, Any]]:
    """Analyse datasets without a fault, seeds from `first` on; each kind of dataset in turn."""
    makers = clean_makers(procedure)
    for seed in range(first, first + count):
        false, error = false_alarms(procedure, makers[seed % len(makers)](seed))
        yield {
            "benchmark": "sabotage",
            "procedure": procedure,
            "clean": seed,
            "error_u": round(error, 2),
            "false": sorted(false),
        }
