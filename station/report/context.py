"""Everything that a report shows beside the results: who, when, on what, and how to redo it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from station.decision import Rule

Row = tuple[str, str]


@dataclass(frozen=True)
class InstrumentRow:
    """An instrument that took part, with its calibration record."""

    name: str
    role: str
    model: str
    serial: str = ""
    firmware: str = ""
    certificate: str = ""
    due_date: str = ""
    overdue: bool = False


@dataclass(frozen=True)
class StepRow:
    """A step of the procedure with the source document's own number; run time in s."""

    number: str
    title: str
    started_s: float | None
    duration_s: float | None
    outcome: str


@dataclass(frozen=True)
class PromptRow:
    """What a person was asked, and who answered what."""

    id: str
    text: str
    answer: str
    answered_by: str


@dataclass(frozen=True)
class SafeStateRow:
    """What was read back from an instrument after it was made safe."""

    instrument: str
    verified: bool
    read_back: str
    seconds: float | None


@dataclass(frozen=True)
class ReportContext:
    """All that a report shows and that is no result; what stays empty is left out of the page.

    `source` names the publication that the procedure follows. `started_utc` and `ended_utc` are
    texts as they are to be read. `simulation` says in sentences what was simulated. `assumptions`
    are the procedure's own sentences on what its numbers do not say. `reproduce` is the command
    that makes the results again from the raw data. `head` is that of the log of the `run`.
    """

    title: str
    source: str = ""
    subject: str = ""
    started_utc: str | None = None
    ended_utc: str | None = None
    operator: str | None = None
    dut: Mapping[str, str] = field(default_factory=dict)
    decision_rule: Rule | None = None
    bench_safe: bool = True
    plan_name: str | None = None
    parameters: Sequence[Row] = ()
    bench_name: str | None = None
    simulated: bool = False
    simulation: Sequence[str] = ()
    instruments: Sequence[InstrumentRow] = ()
    steps: Sequence[StepRow] = ()
    prompts: Sequence[PromptRow] = ()
    safe_state: Sequence[SafeStateRow] = ()
    assumptions: Sequence[str] = ()
    versions: Sequence[Row] = ()
    reproduce: str | None = None
    notes: Sequence[str] = ()
    references: Sequence[Row] = ()
    run: str = ""
    head: str = ""
    laboratory: str = ""
