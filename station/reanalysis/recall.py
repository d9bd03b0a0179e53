"""A certificate that is recalled, and the calibration record that takes its place."""

from __future__ import annotations

import datetime as dt
from dataclasses import replace
from pathlib import Path

from station.fields import StrictModel
from station.files.faults import FaultList
from station.files.validation import check_model
from station.files.yaml.reading import read_yaml
from station.instruments.bench import Bench
from station.instruments.calibration import Calibration


class Recall(StrictModel):
    """The certificate `replaces` holds no more; runs that began on `since` or later are concerned.

    `calibration` is a record as a bench file holds it. Without `since`, all runs are.
    """

    replaces: str
    calibration: Calibration
    since: dt.date | None = None

    def concerned(self, bench: Bench, used: list[str], began: dt.date) -> list[str]:
        """Return the instruments of a run whose record is recalled; `used` are those it opened."""
        if self.since is not None and began < self.since:
            return []
        records = {name: bench.record(name) for name in used}
        return [name for name, record in records.items() if record and self._is(record)]

    def applied(self, bench: Bench) -> Bench:
        """Return the bench with the new record in the place of the recalled one."""
        instruments = {
            name: entry.model_copy(update={"calibration": self.calibration})
            if entry.calibration is not None and self._is(entry.calibration)
            else entry
            for name, entry in bench.instruments.items()
        }
        return replace(bench, file=bench.file.model_copy(update={"instruments": instruments}))

    def _is(self, record: Calibration) -> bool:
        return record.certificate == self.replaces


def read_recall(path: Path) -> Recall:
    """Return what a YAML file recalls; raises FaultList with everything that is wrong in it."""
    recall, faults = check_model(read_yaml(path), Recall)
    if recall is None:
        raise FaultList(faults)
    return recall
