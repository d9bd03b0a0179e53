"""Two runs side by side: where plan, instruments and software differ, and how far results do."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from station.errors import InputError
from station.files.yaml.reading import read_yaml
from station.record.folder import RESULTS, RunFolder, read_run
from station.record.layout import BENCH, PLAN


@dataclass(frozen=True)
class Difference:
    """What is not alike: where, and how it stands in each run; None where a run lacks it."""

    where: str
    first: Any
    second: Any


@dataclass(frozen=True)
class ResultPair:
    """A result of both runs.

    `difference` is the second less the first, in `unit`; `in_u` is that over the root of the sum of
    the squares of both standard uncertainties. What both have from one cause (one gaussmeter) does
    not cancel in that: two runs on one bench agree better than `in_u` says.
    """

    name: str
    axis: str | None
    unit: str
    first: float | None
    second: float | None
    first_u: float | None
    second_u: float | None

    @property
    def difference(self) -> float | None:
        """The second less the first, where both are determined."""
        return None if self.first is None or self.second is None else self.second - self.first

    @property
    def in_u(self) -> float | None:
        """The difference in units of the combined standard uncertainty."""
        u = math.hypot(self.first_u or 0.0, self.second_u or 0.0)
        return None if self.difference is None or u == 0.0 else self.difference / u

    def to_data(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {**asdict(self), "difference": self.difference, "in_u": self.in_u}


@dataclass(frozen=True)
class Comparison:
    """Two runs side by side."""

    runs: tuple[str, str]
    plan: tuple[Difference, ...]
    instruments: tuple[Difference, ...]
    software: tuple[Difference, ...]
    results: tuple[ResultPair, ...]

    def to_data(self) -> dict[str, Any]:
        """Return it as plain data."""
        parts = ("plan", "instruments", "software")
        return {
            "runs": list(self.runs),
            **{part: [asdict(difference) for difference in getattr(self, part)] for part in parts},
            "results": [result.to_data() for result in self.results],
        }


def compare(first: Path, second: Path) -> Comparison:
    """Return how two runs differ; raises InputError for what is no run, or has no results."""
    folders = read_run(first), read_run(second)
    documents = [_document(folder) for folder in folders]
    return Comparison(
        (folders[0].path.name, folders[1].path.name),
        tuple(_differences(*(_leaves(read_yaml(folder.path / PLAN).data) for folder in folders))),
        tuple(_differences(*(_instruments(folder) for folder in folders))),
        tuple(_differences(*(_software(folder) for folder in folders))),
        tuple(_results(*documents)),
    )


def _document(folder: RunFolder) -> Mapping[str, Any]:
    path = folder.path / RESULTS
    if not path.is_file():
        raise InputError(f"{folder.path} has no results to compare; `station analyse` makes them")
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        _by_key(data)
    except (ValueError, LookupError, TypeError) as error:
        raise InputError(
            f"{path} cannot be read ({error}); `station verify` says what was altered"
        ) from error
    return dict(data)


def _leaves(data: Any, where: str = "") -> dict[str, Any]:
    """Return each value of nested mappings by its path; a list is one value."""
    if not isinstance(data, dict):
        return {where: data}
    values = dict[str, Any]()
    for key, value in data.items():
        values |= _leaves(value, f"{where}.{key}" if where else str(key))
    return values


def _instruments(folder: RunFolder) -> dict[str, Any]:
    """Return model, serial number, firmware and certificate of each instrument that took part."""
    entries = read_yaml(folder.path / BENCH).data["instruments"]
    instruments = dict[str, Any]()
    for event in folder.events_of("identified"):
        name = event.details["instrument"]
        for key in ("model", "serial", "firmware"):
            instruments[f"{name} {key}"] = event.details[key]
        record = entries.get(name, {}).get("calibration") or {}
        instruments[f"{name} certificate"] = record.get("certificate")
        instruments[f"{name} due"] = record.get("due") and str(record["due"])
    return instruments


def _software(folder: RunFolder) -> dict[str, Any]:
    facts = folder.run_facts()
    versions = {"station": facts.get("station"), "commit": facts.get("git_commit")}
    return {
        **versions,
        "python": facts.get("python"),
        **facts.get("packages", {}),
        **facts.get("drivers", {}),
    }


def _differences(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[Difference]:
    for where in dict.fromkeys((*first, *second)):
        if first.get(where) != second.get(where):
            yield Difference(where, first.get(where), second.get(where))


def _by_key(document: Mapping[str, Any]) -> dict[tuple[str, str | None, str], Mapping[str, Any]]:
    return {
        (result["name"], result["axis"], result["unit"]): result for result in document["results"]
    }


def _results(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[ResultPair]:
    before, after = _by_key(first), _by_key(second)
    for key in dict.fromkeys((*before, *after)):
        a, b = before.get(key, {}), after.get(key, {})
        u = (a.get("standard_uncertainty"), b.get("standard_uncertainty"))
        yield ResultPair(*key, a.get("value"), b.get("value"), *u)
