"""The certificate of a run, made from its folder alone."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

from station.clock import utc_now
from station.files.plan import Plan
from station.findings import NOT_STATED
from station.instruments.bench import Bench
from station.procedure import Procedure, procedure_of
from station.record.events import head_of_run
from station.record.folder import RunFolder
from station.record.layout import RAW, covered_files
from station.record.series import RunSeries
from station.recorded import read_plan_and_bench
from station.report.certificate_cmc import not_below_cmc
from station.report.certificate_curves import curves_of
from station.report.certificate_fields import (
    Certificate,
    RecordedCondition,
    RoomCondition,
    messages,
)
from station.report.certificate_results import (
    ASSUMED,
    convention_row,
    left_out,
    measured,
    result_row,
    upper_limits,
    verdict_sentence,
)
from station.report.context import Row
from station.report.html import BADGES, RULES
from station.report.numbers import NOTHING
from station.report.run_report import instrument_rows, time_of_day, version_rows
from station.report.seal import seal
from station.report.sheet import Block, Section, Sheet, grid, pairs, sentences
from station.results import ResultDocument
from station.roles.multimeter import DEVICE, places_in
from station.texts import AsTyped
from station.units import UnitError, parse_as

AMBIENT_UNITS = {"degC": "°C", "RH": "% RH", "hPa": "hPa", "%": "%"}
AMBIENT_PLACES = 2
"""Decimal places of what a source recorded."""
DATE = len("2027-01-31")
NO_PACKAGE = ("station", "git commit", "Python", "drivers of ", "computer")
"""How the other rows of software begin."""
SET_POINT = "set_point"
"""Columns that begin so were commanded, not measured."""
AXIS = 1
"""The column of the results that is left out where it is empty."""
USED_ONLY = "Used, with no certificate in a budget of a result"
NO_DEVIATION = "The plan states no deviation from the method."
REPRODUCTION = (
    "This certificate may be reproduced in full only, unless the laboratory agrees in writing."
)
ONLY_ITEMS = "The results relate only to the item that is identified above, as it was received."


def certificate_of_run(
    folder: RunFolder, document: ResultDocument, amendment: tuple[str, ...] = (), form: str = ""
) -> Certificate:
    """Return the certificate of a run; its number follows from what it says.

    The same content has the same number on whatever day it is issued, an amended one another, and
    so has one of another `form`: languages, paper, letterhead.
    """
    plan, bench = read_plan_and_bench(folder)
    procedure = procedure_of(plan.procedure)
    header, laboratory, facts = plan.header, bench.file.laboratory, folder.run_facts()
    references = dict(header.references)
    cited = references.pop("method", "")
    started, ended = str(facts["started_utc"]), str(facts.get("ended_utc") or "")
    rows, others = traceability(folder, plan, bench, procedure)
    document, raised = not_below_cmc(document, laboratory, plan.decision_rule)
    certificate = Certificate(
        title=f"Calibration certificate: {procedure.title}",
        laboratory=laboratory.name if laboratory else "",
        address=laboratory.address if laboratory else "",
        country=(laboratory.country or "") if laboratory else "",
        accreditation=(laboratory.accreditation or "") if laboratory else "",
        location=(laboratory.location or laboratory.address) if laboratory else "",
        number=folder.path.resolve().name,
        customer=header.customer.name if header.customer else "",
        customer_address=header.customer.address if header.customer else "",
        order=references.pop("order", ""),
        work_instruction=references.pop("work_instruction", ""),
        references=tuple(references.items()),
        method=f"{procedure.title}, after: {procedure.source}" if procedure.source else "",
        cited=cited,
        deviations=header.deviations,
        device=tuple(device_rows(plan)),
        condition=header.dut.condition or "",
        received=str(header.dut.received or ""),
        tested=f"{time_of_day(started)} to {time_of_day(ended)} UTC" if ended else "",
        days=(started[:DATE], (ended or started)[:DATE]),
        issued=str(utc_now().date()),
        ambient=tuple(recorded_conditions(folder)),
        room=tuple(room_conditions(folder, plan)),
        traceability=tuple(rows),
        si_statement=(laboratory.si_statement or "") if laboratory else "",
        other_instruments=tuple(others),
        unstated=tuple(unstated_inputs(document)),
        results=tuple(measured(document)),
        conventions=tuple(result for result in document.results if result.by_convention),
        remarks=(*raised, *left_out(document), *upper_limits(document)),
        curves=tuple(curves_of(document, laboratory)),
        assumptions=(*procedure.assumptions, *ASSUMED),
        decision_rule=RULES[plan.decision_rule],
        verdict=verdict_sentence(document),
        flags=tuple(document.flags),
        signatories=tuple(
            (signatory.name, signatory.function) for signatory in laboratory.signatories
        )
        if laboratory
        else (),
        operator=plan.operator or "",
        hashes=tuple(hash_rows(folder)),
        versions=tuple(version_rows(facts)),
        complete=folder.state.measured,
        run=folder.path.resolve().name,
        head=head_of_run(folder.path),
        amendment=amendment,
    )
    return replace(certificate, number=f"{certificate.number}-{digest_of(certificate, form)}")


def digest_of(certificate: Certificate, form: str) -> str:
    """Return eight hexadecimal digits that change with what a certificate says, its date aside."""
    content = json.dumps([content_of(certificate), certificate.number, certificate.amendment, form])
    return hashlib.sha256(content.encode()).hexdigest()[:8]


def content_of(certificate: Certificate) -> str:
    """Return a SHA-256 of what a certificate says, its number, date and amendment aside.

    Nor does it change by what is done with the folder after its run.
    """
    bare = replace(certificate, number="", issued="", run="", head="", amendment=())
    content = {
        **vars(bare),
        "ambient": ambient_rows(certificate),
        "room": room_rows(certificate),
        "results": [result_row(result) for result in certificate.results],
        "conventions": [convention_row(result) for result in certificate.conventions],
        "curves": [table for curves in certificate.curves for table in curves.tables()],
        "flags": messages(certificate.flags),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def amendment_of(number: str, date: str, reason: str) -> tuple[str, ...]:
    """Return in sentences which certificate another one replaces (ISO/IEC 17025:2017, 7.8.8)."""
    return (
        f"This certificate replaces certificate {number}, issued on {date}, which is withdrawn.",
        f"Reason of the amendment: {reason}",
    )


def device_rows(plan: Plan) -> Iterator[tuple[str, str]]:
    """Yield what identifies the device under test."""
    dut = plan.header.dut
    yield "Manufacturer", dut.manufacturer or ""
    yield "Model", dut.model
    yield "Serial number", dut.serial
    yield "Notes", dut.notes or ""


def recorded_conditions(folder: RunFolder) -> Iterator[RecordedCondition]:
    """Yield the extremes and the mean of each condition that a source of the run recorded."""
    series = RunSeries(folder.path, is_condition)
    series.look()
    for source, column, values in series.ranges():
        what, _, unit = column.rpartition("_")
        low, mean, high = (round(value, AMBIENT_PLACES) for value in values)
        place = next(iter(places_in([column])), DEVICE)
        quantity = what.replace("_", " ") if place == DEVICE else f"temperature, {place}"
        yield RecordedCondition(source, quantity, low, mean, high, AMBIENT_UNITS[unit])


def is_condition(column: str) -> bool:
    """Tell whether a column of a record is a condition that was measured."""
    what, _, unit = column.rpartition("_")
    return unit in AMBIENT_UNITS and not what.startswith(SET_POINT)


def ambient_rows(certificate: Certificate) -> list[tuple[str, ...]]:
    """Return source, quantity, smallest, mean and largest value, unit of each as printed."""
    return [
        (
            condition.source,
            condition.quantity,
            *(
                f"{value:.{AMBIENT_PLACES}f}"
                for value in (condition.smallest, condition.mean, condition.largest)
            ),
            condition.unit,
        )
        for condition in certificate.ambient
    ]


def room_conditions(folder: RunFolder, plan: Plan) -> Iterator[RoomCondition]:
    """Yield what a person read of the room: in the plan, or as the answer to a prompt of the run.

    Of several answers, as of a run that was resumed, the last one counts.
    """
    answers = {event.details["id"]: event.details["answer"] for event in folder.events_of("prompt")}
    room = plan.header.room
    for condition in room.conditions() if room is not None else ():
        value, read = condition.value, condition.read
        if value is None:
            with suppress(UnitError):
                value = parse_as(answers.get(condition.prompt_id, ""), condition.unit)
        yield RoomCondition(
            condition.name,
            value,
            condition.uncertainty,
            AMBIENT_UNITS[condition.unit],
            read.instrument,
            read.certificate,
            str(read.due),
            plan.operator or "",
        )


def room_rows(certificate: Certificate) -> list[tuple[str, ...]]:
    """Return the conditions of the room as printed."""
    return [
        (
            read.quantity,
            "" if read.value is None else f"{read.value:g} {read.unit}",
            f"{read.uncertainty:g} {read.unit}",
            read.instrument,
            read.certificate,
            read.due,
            read.typed_by,
        )
        for read in certificate.room
    ]


def traceability(
    folder: RunFolder, plan: Plan, bench: Bench, procedure: Procedure
) -> tuple[list[tuple[str, ...]], list[Row]]:
    """Return the records of the instruments that the results rest on, and name and model of others.

    What only commands and is in no budget needs no record. A record of which nothing is in u makes
    no result traceable.
    """
    uses = [use for use in procedure.records(plan.parameters, bench) if use.in_budget]
    needed = {use.instrument for use in uses if use.needed}
    stated = {
        use.instrument
        for use in uses
        if bench.stated(use.instrument, use.quantity, use.at, use.unit) is not None
    }
    rows: list[tuple[str, ...]] = []
    others: list[Row] = []
    for row in instrument_rows(folder, bench):
        record = bench.record(row.name)
        named = f"{row.model} {row.serial}".strip()
        if row.name not in needed | stated:
            others.append((row.name, named))
        elif record is not None and row.name in stated:
            rows.append(
                (
                    row.name,
                    named,
                    record.certificate or "",
                    str(record.date or ""),
                    str(record.due),
                    record.calibrated_by or "",
                )
            )
    return rows, others


def unstated_inputs(document: ResultDocument) -> Iterator[tuple[str, str]]:
    """Yield what results depend on and nobody states, and the names of those results."""
    resting: dict[str, list[str]] = {}
    for result in document.results:
        for line in result.budget:
            if line.source == NOT_STATED:
                resting.setdefault(line.description, []).append(result.estimate.words)
    for what, names in resting.items():
        yield what, ", ".join(dict.fromkeys(names))


def hash_rows(folder: RunFolder) -> Iterator[tuple[str, str]]:
    """Yield the SHA-256 of each raw file, as the manifest has it."""
    for name, digest in sorted(covered_files(folder.path).items()):
        if name.startswith(f"{RAW}/"):
            yield name, digest


def software_rows(certificate: Certificate) -> list[Row]:
    """Return the software and the computer, all packages in a row."""
    packages = [row for row in certificate.versions if not row[0].startswith(NO_PACKAGE)]
    rows = [row for row in certificate.versions if row not in packages]
    if packages:
        rows.insert(-1, ("packages", ", ".join(f"{name} {text}" for name, text in packages)))
    return rows


def sheet_of(certificate: Certificate) -> Sheet:
    """Return a certificate as the sections of a page."""
    drafts = certificate.draft_reasons()
    return Sheet(
        kind="Certificate",
        title=certificate.title,
        number=certificate.number,
        laboratory=certificate.laboratory,
        address=certificate.address,
        accreditation=certificate.accreditation,
        drafts=drafts,
        sections=tuple(section for section in sections_of(certificate) if section.blocks),
    )


def sections_of(certificate: Certificate) -> Iterator[Section]:
    """Yield the sections in their order; fields without text are left out."""
    customer = ", ".join(filter(None, (certificate.customer, certificate.customer_address)))
    head = (
        *as_typed(("Customer", customer), ("Order", certificate.order)),
        *((AsTyped(name), AsTyped(text)) for name, text in certificate.references),
        *as_typed(*certificate.device, ("Condition", certificate.condition)),
        ("Received", certificate.received),
        ("Tested", certificate.tested),
        ("Issued", certificate.issued),
        *as_typed(("Location", certificate.location), ("Operator", certificate.operator)),
    )
    if certificate.amendment:
        yield Section("Amendment", (sentences(certificate.amendment),))
    yield Section("Customer and device", (pairs(head),))
    method = (
        ("Method", certificate.method),
        *as_typed(
            ("Cited as", certificate.cited), ("Work instruction", certificate.work_instruction)
        ),
    )
    deviations = sentences(tuple(map(AsTyped, certificate.deviations)) or (NO_DEVIATION,))
    yield Section("Method", (pairs(method), replace(deviations, title="Deviations")))
    yield Section("Results", tuple(result_blocks(certificate)))
    yield Section("What the results rest on", (sentences(certificate.assumptions),))
    if certificate.flags:
        yield Section("What the reader must know", (sentences(messages(certificate.flags)),))
    columns = ("Source", "Quantity", "Smallest", "Mean", "Largest", "Unit")
    if certificate.ambient:
        rows = ambient_rows(certificate)
        yield Section("Conditions measured during the run", (grid(columns, rows),))
    if certificate.room:
        read = ("Quantity", "Value", "u", "Read on", "Certificate", "Due", "Typed by")
        room = [
            (row[0], *map(AsTyped, (text or NOTHING for text in row[1:])))
            for row in room_rows(certificate)
        ]
        yield Section("Conditions of the room", (grid(read, room),))
    yield Section("Traceability", tuple(traceability_blocks(certificate)))
    hashes = grid(("File of the run", "SHA-256"), certificate.hashes)
    yield Section("Raw data and software", (hashes, pairs(software_rows(certificate))))
    if certificate.head:
        yield Section("Seal", (seal(certificate.run, certificate.head),))
    yield Section("Statements", (sentences((ONLY_ITEMS, REPRODUCTION)),))
    signed = tuple(
        (AsTyped(f"{name}, {function}"), "") for name, function in certificate.signatories
    )
    yield Section("Authorised by", (Block("signatures", rows=signed or (("", ""),)),))


def as_typed(*rows: tuple[str, str]) -> Iterator[tuple[str, str]]:
    """Yield names with texts that are a person's, in that one's words."""
    for name, text in rows:
        yield name, AsTyped(text)


def is_decided(certificate: Certificate) -> bool:
    """Tell whether a limit was asked for, and so something is decided."""
    return certificate.verdict != BADGES["none"][1]


def result_blocks(certificate: Certificate) -> Iterator[Block]:
    """Yield the table of results, with the decision where a limit was asked for."""
    rows, decided = [result_row(result) for result in certificate.results], is_decided(certificate)
    columns = ["Quantity", "Axis", "Value", "U", "k", "Unit"]
    if decided:
        columns += ["Limit", "Decision"]
    if any(row[8] for row in rows):
        columns.append("Probability of conformity")
    caption = (
        "U = k · u is the expanded uncertainty for a coverage of 95 %, with k from Student's "
        "distribution and the effective degrees of freedom (GUM, annex G). It has two significant "
        "digits, and the value is rounded to it."
    )
    # A device that has no axes needs no column of them.
    kept = [n for n in range(len(columns)) if n != AXIS or any(row[AXIS] for row in rows)]
    yield grid([columns[n] for n in kept], [[row[n] for n in kept] for row in rows], caption)
    if decided:
        yield pairs(
            (("Decision", certificate.verdict), ("Decision rule", certificate.decision_rule))
        )
    else:
        yield sentences(("No limit was asked for: this is no statement of conformity.",))
    if certificate.conventions:
        named = ("Quantity", "Axis", "Value", "Unit")
        set_rows = [convention_row(result) for result in certificate.conventions]
        yield grid(named, set_rows, title="Set by convention, not measured")
    if certificate.remarks:
        yield sentences(certificate.remarks)
    for curves in certificate.curves:
        for title, names, lines, below in curves.tables():
            yield grid(names, lines, below, title)


def traceability_blocks(certificate: Certificate) -> Iterator[Block]:
    """Yield the records that the results rest on, and what was used without being in a result."""
    columns = ("Instrument", "Model, serial number", "Certificate", "Date", "Due", "Calibrated by")
    if certificate.traceability:
        rows = [
            (*row[:2], *map(AsTyped, (text or NOTHING for text in row[2:])))
            for row in certificate.traceability
        ]
        caption = "The results are traceable through these certificates, and through no other."
        yield grid(columns, rows, caption)
    if certificate.si_statement:
        yield sentences((AsTyped(certificate.si_statement),))
    if certificate.other_instruments:
        yield grid(columns[:2], certificate.other_instruments, title=USED_ONLY)
