"""From the record of the contacts' part to its findings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.not_measured import not_measured
from station.findings import Analysis, Findings, findings_of

from .analysis import DONE, analyse_chain, analyse_door
from .parameters import CHAIN_ERRORS, DOOR_ERRORS, RESULTS, UNIT, ContactParameters, chain_unit

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def findings(folder: RunFolder, parameters: ContactParameters, bench: Bench) -> Findings:
    """Return what the contacts read; what was not walked whole gives nothing."""
    units = folder.finished_units()
    chain = {name: chain_unit(name) for name in parameters.chain}
    wanted = [*([UNIT] if parameters.door else []), *chain.values()]
    missing = [unit for unit in wanted if unit not in units]
    if missing:
        names = [*([DOOR_ERRORS] if parameters.door else []), *([CHAIN_ERRORS] if chain else [])]
        results = {name: RESULTS[name] for name in names}
        return findings_of(not_measured("contacts", results, missing), None, [])
    parts = []
    if parameters.door:
        parts.append(analyse_door({done: str(units[UNIT][done]) for done in DONE}))
    if chain:
        parts.append(analyse_chain({name: units[unit]["opened"] for name, unit in chain.items()}))
    estimates = [estimate for part in parts for estimate in part.estimates]
    flags = tuple(flag for part in parts for flag in part.flags)
    return findings_of(Analysis(estimates, (), flags), None, [])
