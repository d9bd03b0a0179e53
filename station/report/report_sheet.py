"""The report of a run as a sheet, for paper: the same context, results and parts as the HTML."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from station.parts import Part
from station.plots import Plot
from station.report.budgets import budgets_of
from station.report.context import ReportContext
from station.report.html import badge_of, flag_title, published_rows, result_rows
from station.report.numbers import format_duration
from station.report.seal import seal
from station.report.sheet import Block, Section, Sheet, grid, pairs, sentences
from station.results import ResultDocument
from station.texts import IN_ENGLISH, Texts


def report_sheet(
    number: str,
    context: ReportContext,
    document: ResultDocument,
    parts: Sequence[Part],
    texts: Texts = IN_ENGLISH,
) -> Sheet:
    """Return the report as a sheet; `number` is the run's and stands on every page."""
    return Sheet(
        kind="Measurement report",
        title=context.title,
        number=number,
        laboratory=context.laboratory or context.bench_name or "",
        address=f"Source: {context.source}" if context.source else "",
        accreditation="",
        sections=tuple(
            section for section in _sections(context, document, parts, texts) if section.blocks
        ),
        contents=True,
    )


def _sections(
    context: ReportContext, document: ResultDocument, parts: Sequence[Part], texts: Texts
) -> Iterator[Section]:
    badge = badge_of(document, context)
    head = (
        *context.dut.items(),
        ("Started (UTC)", context.started_utc or ""),
        ("Ended (UTC)", context.ended_utc or ""),
        ("Operator", context.operator or ""),
        ("Test plan", context.plan_name or ""),
        ("Bench", context.bench_name or ""),
        *context.references,
        ("Verdict", f"{badge['words']}. {badge['why']}"),
    )
    yield Section("What was measured", (pairs(head),))
    yield Section("Simulated: no real device was measured", _list(context.simulation))
    yield Section("Results", (_results(document),))
    if document.published:
        yield Section("The published formula on the same data", (_published(document),))
    flags = [
        (" ".join(filter(None, (flag_title(flag.code, texts), flag.code, flag.axis))), flag.message)
        for flag in document.flags
    ]
    yield Section("What the reader must know", (pairs(flags),) if flags else ())
    yield Section("Measurement and analysis", tuple(_part(part, texts) for part in parts))
    yield Section("Uncertainty budget", tuple(_budgets(document)))
    yield Section("Parameters of the plan", (pairs(context.parameters),))
    yield Section("Steps", tuple(_steps(context)))
    yield Section("Instruments and their calibration", tuple(_instruments(context)))
    yield Section("Safe state at the end", tuple(_safe_state(context)))
    yield Section("What this report does not say", _list(context.assumptions))
    yield Section("Notes", _list(context.notes))
    yield Section("Seal", (seal(context.run, context.head),) if context.head else ())
    again = (("Results again", context.reproduce or ""), *context.versions)
    yield Section("Versions", (pairs(again),))


def _list(texts: Sequence[str]) -> tuple[Block, ...]:
    return (sentences(texts),) if texts else ()


def _results(document: ResultDocument) -> Block:
    columns = ("Quantity", "Axis", "Value", "u", "k", "U", "DoF", "Unit", "Limit", "Verdict")
    keys = ("name", "axis", "value", "u", "k", "U", "dof", "unit", "limit", "words")
    rows = []
    for row in result_rows(document.results):
        at = f" at {row['at']}" if row["at"] else ""
        rows.append([f"{row['name']}{at}", *(row[key] for key in keys[1:])])
    return grid(columns, rows, "U = k · u, for a coverage of 95 %. DoF: degrees of freedom.")


def _published(document: ResultDocument) -> Block:
    columns = ("Quantity", "Axis", "As published", "Best", "Difference", "In u", "Unit", "Method")
    keys = ("name", "axis", "published", "value", "difference", "in_u", "unit", "method")
    return grid(columns, [[row[key] for key in keys] for row in published_rows(document)])


def _part(part: Part, texts: Texts) -> Block:
    if isinstance(part, Plot):
        from station.report.drawing import png_of

        return Block("picture", part.title, part.caption, image=png_of(part, texts))
    return grid(part.columns, part.rows, part.caption, part.title)


def _budgets(document: ResultDocument) -> Iterator[Block]:
    for budget in budgets_of(document.results):
        axes = budget["axes"]
        of_axes = [f"{axis}: in {budget['unit']}" for axis in axes]
        each = [text for name in of_axes for text in (name, "%")]
        columns = (
            *("Contribution", "Type", "Standard uncertainty", "Distribution", "Sensitivity"),
            *(each if axes[1:] else (f"In {budget['unit']}", "Share, %")),
            "Source",
        )
        keys = ("description", "kind", "u", "distribution", "sensitivity")
        rows = []
        for row in budget["rows"]:
            numbers = [cell[key] for cell in row["cells"] for key in ("contribution", "share")]
            rows.append([*(row[key] for key in keys), *numbers, row["source"]])
        totals = [text for total in budget["totals"] for text in (total, "")]
        rows.append(["combined", "", "", "", "", *totals, ""])
        if axes[1:]:
            title = f"{budget['name']} of axes {' '.join(axes)}"
        else:
            title = f"{budget['name']} of axis {axes[0]}" if axes[0] else budget["name"]
        yield grid(columns, rows, title=title)


def _steps(context: ReportContext) -> Iterator[Block]:
    rows = [
        (
            step.number,
            step.title,
            format_duration(step.started_s),
            format_duration(step.duration_s),
            step.outcome,
        )
        for step in context.steps
    ]
    if rows:
        yield grid(("Step", "What was done", "Started at", "Took", "Outcome"), rows)


def _instruments(context: ReportContext) -> Iterator[Block]:
    rows = [
        (
            row.name,
            row.model,
            row.serial,
            row.firmware,
            row.certificate,
            f"{row.due_date}{' overdue' if row.overdue else ''}",
        )
        for row in context.instruments
    ]
    if rows:
        columns = ("Name", "Maker and model", "Serial", "Firmware", "Certificate", "Due")
        yield grid(columns, rows)


def _safe_state(context: ReportContext) -> Iterator[Block]:
    rows = [
        (row.instrument, "yes" if row.verified else "NOT VERIFIED", row.read_back)
        for row in context.safe_state
    ]
    if rows:
        yield grid(("Instrument", "Verified", "Read back"), rows)
