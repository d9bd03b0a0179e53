"""What a certificate must say (ISO/IEC 17025:2017, 7.8.2 and 7.8.4), and what makes it a draft."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

from station.files.statements import says_something
from station.findings import Flag
from station.record.events import STANDARD_ALARM
from station.report.certificate_curves import Curves
from station.report.context import Row
from station.results import OUTSIDE_RANGE, UNCALIBRATED, UNSAFE, Result

MANDATORY: Mapping[str, tuple[str, str, str]] = {
    "title": ("7.8.2.1 a", "title", "the procedure"),
    "laboratory": ("7.8.2.1 b", "name of the laboratory", "`laboratory.name` of the bench file"),
    "address": ("7.8.2.1 b", "address of the laboratory", "`laboratory.address` of the bench file"),
    "location": ("7.8.2.1 c", "location of the work", "`laboratory.location` of the bench file"),
    "number": ("7.8.2.1 d", "number of the certificate", "the run folder"),
    "customer": ("7.8.2.1 e", "name of the customer", "`customer.name` of the plan"),
    "customer_address": ("7.8.2.1 e", "address of the customer", "`customer.address` of the plan"),
    "order": ("7.8.2.1 e", "customer's order", "`references.order` of the plan"),
    "method": ("7.8.2.1 f", "method", "the procedure"),
    "work_instruction": (
        "7.8.2.1 f",
        "work instruction",
        "`references.work_instruction` of the plan",
    ),
    "device": ("7.8.2.1 g", "identification of the device", "`dut` of the plan"),
    "condition": ("7.8.2.1 g", "condition of the device", "`dut.condition` of the plan"),
    "received": ("7.8.2.1 h", "date of receipt", "`dut.received` of the plan"),
    "tested": ("7.8.2.1 i", "dates of the test", "the run"),
    "issued": ("7.8.2.1 j", "date of issue", "the run"),
    "results": ("7.8.2.1 m", "result", "the run"),
    "signatories": ("7.8.2.1 o", "authorised signatory", "`laboratory.signatories` of the bench"),
    "ambient": (
        "7.8.4.1 b",
        "condition measured during the run",
        "a source that records it, or `room` of the plan",
    ),
    "traceability": (
        "7.8.4.1 c",
        "instrument with a calibration record",
        "`calibration` in the bench file",
    ),
}
"""Field of `Certificate`: clause, its name, and where a laboratory writes it."""

REASONS = (
    "simulated",
    UNCALIBRATED,
    "calibration-overdue",
    STANDARD_ALARM,
    OUTSIDE_RANGE,
    "calibration-unused",
    UNSAFE,
    "not-read-back",
    "data-damaged",
)
"""Flags of a run of which no certificate is issued."""


@dataclass(frozen=True)
class RecordedCondition:
    """A condition that a source of the run recorded, as it is stated."""

    source: str
    quantity: str
    smallest: float
    mean: float
    largest: float
    unit: str


@dataclass(frozen=True)
class RoomCondition:
    """A condition of the room, its standard uncertainty, what read it, and who typed it.

    A value that nobody typed is None.
    """

    quantity: str
    value: float | None
    uncertainty: float
    unit: str
    instrument: str
    certificate: str
    due: str
    typed_by: str


@dataclass(frozen=True)
class Certificate:
    """The fields of a certificate before they are set; what is empty is missing.

    HTML, PDF and the digital certificate all draw from it. `days` are the first and the last of
    the test. `traceability` has a row for each instrument that the results rest on: name, model and
    serial, certificate, date, due, who calibrated it. `unstated` has what results depend on and
    nobody states, and those results. `results` are those that were measured, no U below the CMC;
    `conventions` those that were set and not measured, and `remarks` says in sentences which the
    data do not determine, and whose U is the CMC. `head` is that of the run's log; `amendment` says
    which certificate it replaces, and why.
    """

    title: str
    laboratory: str
    address: str
    country: str
    accreditation: str
    location: str
    number: str
    customer: str
    customer_address: str
    order: str
    references: tuple[Row, ...]
    method: str
    cited: str
    work_instruction: str
    deviations: tuple[str, ...]
    device: tuple[Row, ...]
    condition: str
    received: str
    tested: str
    days: tuple[str, str]
    issued: str
    ambient: tuple[RecordedCondition, ...]
    room: tuple[RoomCondition, ...]
    traceability: tuple[tuple[str, ...], ...]
    si_statement: str
    other_instruments: tuple[Row, ...]
    unstated: tuple[Row, ...]
    results: tuple[Result, ...]
    conventions: tuple[Result, ...]
    remarks: tuple[str, ...]
    curves: tuple[Curves, ...]
    assumptions: tuple[str, ...]
    decision_rule: str
    verdict: str
    flags: tuple[Flag, ...]
    signatories: tuple[tuple[str, str], ...]
    operator: str
    hashes: tuple[Row, ...]
    versions: tuple[Row, ...]
    complete: bool
    run: str = ""
    head: str = ""
    amendment: tuple[str, ...] = ()

    def draft_reasons(self) -> tuple[str, ...]:
        """Return in sentences why this is no certificate yet; none where it may be issued."""
        return (*missing_fields(self), *self._reasons())

    def _reasons(self) -> Iterator[str]:
        if not self.complete:
            yield "The run did not go through all its steps."
        # Somewhere on earth the day after that in UTC has begun.
        latest = str(dt.date.fromisoformat(self.days[0]) + dt.timedelta(days=1))
        if self.received > latest:
            yield (
                f"The device was received on {self.received}, and tested on {self.days[0]} "
                "(7.8.2.1 h): `dut.received` of the plan."
            )
        for read in self.room:
            if read.value is None:
                yield (
                    f"The {read.quantity} of the room was not typed (7.8.4.1 b): `room` of the "
                    "plan, or the answer to the run's prompt."
                )
            if self.days[1] > read.due:
                yield (
                    f"The room was read on {read.instrument}, whose calibration was due on "
                    f"{read.due} (7.8.4.1 c)."
                )
        for row in self.traceability:
            if row[3] > latest:
                yield (
                    f"The calibration of {row[0]} is dated {row[3]}, after the test: the record "
                    "that held on that day is missing (7.8.4.1 c): `calibration` in the bench file."
                )
            if not all(map(says_something, row)):
                yield (
                    f"The calibration record of {row[0]} lacks certificate, date, due date or who "
                    "calibrated it (7.8.4.1 c): `calibration` in the bench file."
                )
        for what, names in self.unstated:
            yield (
                f"Nobody states how well this is known, on which {names} depends: {what}. u lacks "
                "that part (7.8.4.1 a): state it in the plan, or in the calibration record of the "
                "instrument."
            )
        yield from messages(flag for flag in self.flags if flag.code in REASONS)


def missing_fields(certificate: Certificate) -> Iterator[str]:
    """Yield a sentence for each mandatory field that is empty, or says nothing."""
    known = {field.name for field in fields(certificate)}
    for name, (clause, words, where) in MANDATORY.items():
        assert name in known, name
        stated = getattr(certificate, name)
        if name == "ambient":
            stated = stated or certificate.room
        if not stated or (isinstance(stated, str) and not says_something(stated)):
            yield f"The {words} is missing ({clause}): {where}."


def messages(flags: Iterator[Flag] | Sequence[Flag]) -> list[str]:
    """Return what flags say, each once."""
    return list(dict.fromkeys(flag.message for flag in flags))
