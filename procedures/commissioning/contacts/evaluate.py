"""From the record of the contacts' part to its findings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.not_measured import not_measured
from station.findings import Findings, findings_of

from .analysis import DONE, analyse
from .parameters import RESULTS, UNIT, ContactParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def findings(folder: RunFolder, parameters: ContactParameters, bench: Bench) -> Findings:
    """Return what the contact reads; a run without its record gives nothing."""
    found = folder.finished_units().get(UNIT)
    if found is None:
        return findings_of(not_measured("contacts", RESULTS, [UNIT]), None, [])
    return findings_of(analyse({done: str(found[done]) for done in DONE}), None, [])
