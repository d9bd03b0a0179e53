"""What a certificate must say (ISO/IEC 17025:2017, 7.8.2 and 7.8.4), and what makes it a draft."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

from station.findings import Flag
from station.report.context import Row

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
    "ambient": ("7.8.4.1 a", "condition measured during the run", "a source that records it"),
    "traceability": (
        "7.8.4.1 c",
        "instrument with a calibration record",
        "`calibration` in the bench file",
    ),
}
"""Field of `Certificate`: clause, its name, and where a laboratory writes it."""

REASONS = (
    "simulated",
    "uncalibrated",
    "calibration-overdue",
    "outside-certified-range",
    "safe-state-unverified",
    "not-read-back",
    "data-damaged",
)
"""Flags of a run of which no certificate is issued."""


@dataclass(frozen=True)
class Certificate:
    """The fields of a certificate as texts and rows; what is empty is missing.

    `traceability` has a row for each instrument that the results rest on: name, model and serial,
    certificate, date, due, who calibrated it. `results` has name, axis, value, U, k, unit, limit,
    verdict and probability of conformity.
    """

    title: str
    laboratory: str
    address: str
    accreditation: str
    location: str
    number: str
    customer: str
    customer_address: str
    order: str
    references: tuple[Row, ...]
    method: str
    work_instruction: str
    deviations: tuple[str, ...]
    device: tuple[Row, ...]
    condition: str
    received: str
    tested: str
    issued: str
    ambient: tuple[tuple[str, ...], ...]
    traceability: tuple[tuple[str, ...], ...]
    other_instruments: tuple[str, ...]
    results: tuple[tuple[str, ...], ...]
    decision_rule: str
    verdict: str
    flags: tuple[Flag, ...]
    signatories: tuple[tuple[str, str], ...]
    operator: str
    hashes: tuple[Row, ...]
    versions: tuple[Row, ...]
    complete: bool

    def draft_reasons(self) -> tuple[str, ...]:
        """Return in sentences why this is no certificate yet; none where it may be issued."""
        return (*missing_fields(self), *self._reasons())

    def _reasons(self) -> Iterator[str]:
        if not self.complete:
            yield "The run did not go through all its steps."
        for row in self.traceability:
            if not all(row):
                yield (
                    f"The calibration record of {row[0]} lacks certificate, date, due date or who "
                    "calibrated it (7.8.4.1 c): `calibration` in the bench file."
                )
        yield from messages(flag for flag in self.flags if flag.code in REASONS)


def missing_fields(certificate: Certificate) -> Iterator[str]:
    """Yield a sentence for each mandatory field that is empty."""
    known = {field.name for field in fields(certificate)}
    for name, (clause, words, where) in MANDATORY.items():
        assert name in known, name
        if not getattr(certificate, name):
            yield f"The {words} is missing ({clause}): {where}."


def messages(flags: Iterator[Flag] | Sequence[Flag]) -> list[str]:
    """Return what flags say, each once."""
    return list(dict.fromkeys(flag.message for flag in flags))
