"""From the record of a commissioning to its findings: those of all its parts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.findings import Findings

from . import chosen
from .parameters import CommissioningParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def findings_of_run(
    folder: RunFolder, parameters: CommissioningParameters, bench: Bench
) -> Findings:
    """Return the figures and causes of every part that was recorded."""
    found: list[Findings] = [part.findings(folder, own, bench) for part, own in chosen(parameters)]
    return Findings(
        estimates=[one for part in found for one in part.estimates],
        published=[one for part in found for one in part.published],
        flags=[one for part in found for one in part.flags],
        inputs=[one for part in found for one in part.inputs],
        detail=[part.detail for part in found],
    )
