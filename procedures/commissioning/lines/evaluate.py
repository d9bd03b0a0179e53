"""From the record of the lines' part to its findings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.not_measured import not_measured
from station.findings import Findings, findings_of
from station.procedure import ResultKind
from station.roles.base import ANSWER_TIME, MAX_DEADLINE_S

from .analysis import Answers, AnswerTime, Kept, analyse
from .parameters import RESULTS, LineParameters, line_unit, return_unit
from .steps import BEFORE, SINCE, SOURCE

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def findings(folder: RunFolder, parameters: LineParameters, bench: Bench) -> Findings:
    """Return the figures of the lines; a run without all their records gives none."""
    wanted = [line_unit(name) for name in parameters.instruments]
    wanted += [return_unit(name) for name in parameters.disconnected]
    if missing := [unit for unit in wanted if unit not in folder.finished_units()]:
        axes = parameters.instruments
        asked = {name: ResultKind(axes, kind.unit) for name, kind in RESULTS.items()}
        return findings_of(not_measured("lines", asked, missing), None, [])
    by_name: dict[str, Answers] = {
        name: answers(folder, line_unit(name)) for name in parameters.instruments
    }
    returned: dict[str, Answers] = {
        name: answers(folder, return_unit(name)) for name in parameters.disconnected
    }
    units = folder.finished_units()
    kept: dict[str, Kept] = {
        name: Kept(tuple(details[BEFORE]), tuple(details[SINCE]))
        for name in parameters.instruments
        if BEFORE in (details := units[line_unit(name)])
    }
    return findings_of(analyse(by_name, returned, kept, longest(folder)), by_name, [])


def longest(folder: RunFolder) -> dict[str, AnswerTime]:
    """Return by instrument the last answer time that was noted: of the largest share."""
    return {
        str(event.details["instrument"]): AnswerTime(
            str(event.details["message"]),
            float(event.details["took_s"]),
            float(event.details["deadline_s"]),
            MAX_DEADLINE_S,
        )
        for event in folder.events_of(ANSWER_TIME)
    }


def answers(folder: RunFolder, unit: str) -> Answers:
    """Return what came of the questions of a unit of work."""
    rows = folder.rows(SOURCE, unit)
    return Answers(rows["latency_s"], rows["answered"] > 0, rows["same"] > 0)
