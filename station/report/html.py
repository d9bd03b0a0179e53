"""The report as one HTML page that needs nothing beside it: no script, no link, plots inside."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from station.decision import Decision
from station.findings import Published
from station.parts import Part, Table
from station.plots import Plot
from station.report.budgets import budgets_of
from station.report.context import ReportContext
from station.report.numbers import (
    NOTHING,
    UNDETERMINED,
    align_decimals,
    format_degrees_of_freedom,
    format_duration,
    format_like,
    format_limit,
    format_number,
    format_with_uncertainty,
    is_numeric_column,
    typeset,
)
from station.report.seal import seal
from station.report.typesetting import with_signs
from station.results import LIMIT_WITHOUT_RESULT, Result, ResultDocument
from station.texts import FLAGS, IN_ENGLISH, Texts, catalogue, tag, translator

BADGES = {
    "pass": ("✓", "Within limits"),
    "fail": ("✗", "Outside a limit"),
    "inconclusive": ("?", "Not decided"),
    "none": ("–", "No limit asked for"),
}
VERDICTS = {
    "pass": "within",
    "fail": "outside",
    "inconclusive": "not decided",
    "none": "no limit",
}
DETAILS = {
    "conditional-pass": "within, but by less than U",
    "conditional-fail": "outside, but by less than U",
    "undetermined": "undetermined",
    "wrong-excitation": "not decided: wrong excitation",
    "uncalibrated": "not decided: not calibrated",
    "outside-certified-range": "not decided: outside the certified range",
    "safe-state-unverified": "not decided: safe state not verified",
    "data-damaged": "not decided: data damaged",
    "run-goes-on": "not decided: the run goes on",
}
RULES = {
    "simple": "Simple acceptance: the value alone is held against its limit; the uncertainty is "
    "stated, not taken off (JCGM 106:2012).",
    "guarded": "Guarded acceptance: the expanded uncertainty U is the guard band, so a pass and a "
    "fail are each right with a probability of at least 95 % (JCGM 106:2012).",
}


def render_html(
    document: ResultDocument,
    context: ReportContext,
    parts: Sequence[Part],
    texts: Texts = IN_ENGLISH,
) -> str:
    """Return the report as one self-contained HTML page; same inputs give the same text."""
    return (
        environment(texts)
        .get_template("report.html.j2")
        .render(
            context=context,
            document=document,
            css=style(),
            badge=badge_of(document, context),
            rule=RULES[context.decision_rule] if context.decision_rule else None,
            results=result_rows(document.results),
            published=published_rows(document),
            flags=document.flags,
            parts=[_part(part, texts) for part in parts],
            budgets=budgets_of(document.results),
            seal=seal(context.run, context.head) if context.head else None,
        )
    )


def render_parts(title: str, about: str, parts: Sequence[Part]) -> str:
    """Return a page of plots and tables alone, in the style of the report."""
    template = environment().get_template("parts.html.j2")
    return template.render(
        title=title, about=about, css=style(), parts=[_part(p, IN_ENGLISH) for p in parts]
    )


def environment(texts: Texts = IN_ENGLISH) -> Environment:
    """Return the templates of all pages, with their filters for texts, numbers and times."""
    environment = Environment(
        loader=PackageLoader("station", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["t"] = texts
    environment.globals["tag"] = tag(texts.languages[0])
    environment.filters["t"] = lambda text: _lines(with_signs(texts(text)))
    environment.filters["words"] = lambda text: " ".join(with_signs(texts(text)).splitlines())
    environment.filters["flag"] = lambda code: flag_title(code, texts)
    environment.filters["lines"] = lambda text: _lines(with_signs(text))
    environment.filters["units"] = with_signs
    environment.filters["minus"] = lambda text: with_signs(
        typeset(" ".join(texts(text).splitlines()) if text.strip() == UNDETERMINED else text)
    )
    environment.filters["methods"] = lambda methods: _lines(methods_in_words(methods, texts))
    environment.filters["duration"] = format_duration
    environment.filters["moment"] = _moment
    environment.filters["png"] = data_uri
    return environment


def data_uri(png: bytes) -> str:
    """Return a picture as it stands in a page."""
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"


def _lines(text: str) -> Markup:
    """Return a text with its lines one below the other, what is typed set apart."""
    return Markup("<br>").join(map(_line, text.splitlines()))


def _line(text: str) -> Markup:
    parts = text.split("`")
    if len(parts) % 2 == 0:  # a sign without its other one
        return escape(text)
    typed = Markup("<code>{}</code>").format
    return Markup("").join(typed(part) if n % 2 else part for n, part in enumerate(parts))


def methods_in_words(methods: Iterable[str], texts: Texts) -> str:
    """Return the methods of results as a sentence in each language, a line each."""
    named = [*dict.fromkeys(methods)]
    each = map(translator, texts.languages)
    return "\n".join(said(f"Method: {said(', ').join(map(said, named))}.") for said in each)


def flag_title(code: str, texts: Texts) -> str:
    """Return what a flag is called in a language; nothing in English, where its code says it."""
    return catalogue(texts.languages[0], FLAGS).get(code, "")


def style() -> Markup:
    """Return the style sheet of all pages."""
    css = resources.files("station.report").joinpath("report.css").read_text(encoding="utf-8")
    return Markup(css)


def badge_of(document: ResultDocument, context: ReportContext) -> dict[str, str]:
    """Return the verdict as a person would say it: mark, words and one sentence why."""
    mark, words = BADGES[document.verdict]
    asked = [result for result in document.results if result.limit is not None]
    lacking = sum(flag.code == LIMIT_WITHOUT_RESULT for flag in document.flags)
    inside = sum(result.decision.verdict == "pass" for result in asked)
    outside = sum(result.decision.verdict == "fail" for result in asked)
    if not asked and not lacking:
        why = "No limit was given; the values stand for themselves."
    else:
        why = counted(inside, outside, len(asked) + lacking - inside - outside)
    if not document.excited:
        why = "The device was not exposed to the commanded field: see the flags. No verdict on it."
    if not context.bench_safe:
        why += " The bench's safe state was not verified, so this run cannot pass."
    return {"verdict": document.verdict, "mark": mark, "words": words, "why": why}


def counted(inside: int, outside: int, undecided: int) -> str:
    """Return in a sentence how many results with a limit are within it, outside, undecided."""
    counts = [(inside, "within"), (outside, "outside"), (undecided, "undecided")]
    listed = ", ".join(f"{number} {word}" for number, word in counts if number)
    count = inside + outside + undecided
    if count == 1:
        return f"{count} result has a limit: {listed}."
    return f"{count} results have a limit: {listed}."


def result_rows(results: Sequence[Result]) -> list[dict[str, str]]:
    """Return the texts of the results table, decimal points in line within each column."""
    rows = []
    for result in results:
        estimate, combined = result.estimate, result.combined
        uncertainty = combined.standard_uncertainty if combined else None
        value, standard = format_with_uncertainty(estimate.value, uncertainty)
        expanded = result.expanded_uncertainty
        rows.append(
            {
                "name": estimate.words,
                "at": estimate.holds_at,
                "axis": estimate.axis or "",
                "value": value,
                "u": standard,
                "k": f"{combined.coverage_factor:.2f}" if combined else NOTHING,
                "U": format_with_uncertainty(expanded, expanded)[1] if combined else NOTHING,
                "dof": format_degrees_of_freedom(combined.degrees_of_freedom)
                if combined
                else NOTHING,
                "unit": estimate.unit,
                "limit": format_limit(result.limit),
                "verdict": result.decision.verdict,
                "words": verdict_words(result.decision),
                "method": estimate.method,
            }
        )
    return _aligned(rows, ("value", "u", "k", "U", "dof"))


def published_rows(document: ResultDocument) -> list[dict[str, str]]:
    """Return the source document's values beside the best ones, with their difference."""
    best = {(result.estimate.name, result.estimate.axis): result for result in document.results}
    rows = []
    for published in document.published:
        result = best.get((published.name, published.axis))
        value, difference, in_u, text = None, NOTHING, NOTHING, NOTHING
        published_text = _published_text(published, result)
        if result is not None:
            value = result.estimate.value
            u = result.combined.standard_uncertainty if result.combined else None
            text = format_with_uncertainty(value, u)[0]
            if value is not None and published.value is not None:
                difference = format_like(published.value - value, text)
                if u:
                    in_u = f"{(published.value - value) / u:+.1f}".replace("-0.0", "+0.0")
        rows.append(
            {
                "name": result.estimate.words if result else published.name.replace("_", " "),
                "axis": published.axis or "",
                "published": published_text,
                "value": text,
                "difference": difference,
                "in_u": in_u,
                "unit": published.unit,
                "method": published.method,
            }
        )
    return _aligned(rows, ("published", "value", "difference", "in_u"))


def _published_text(published: Published, result: Result | None) -> str:
    if published.value is None:
        return UNDETERMINED
    if result is None or result.combined is None:
        return format_number(published.value)
    return format_with_uncertainty(published.value, result.combined.standard_uncertainty)[0]


def _part(part: Part, texts: Texts) -> dict[str, Any]:
    """Return a part of the procedure as the template draws it."""
    if isinstance(part, Plot):
        from station.report.drawing import CSS_DPI, DPI, png_of

        png = png_of(part, texts)
        # Width and height stand in the first chunk (PNG specification, 11.2.2).
        width, height = (int.from_bytes(png[at : at + 4], "big") for at in (16, 20))
        return {
            "kind": "plot",
            "title": part.title,
            "caption": part.caption,
            "image": data_uri(png),
            "width": round(width * CSS_DPI / DPI),
            "height": round(height * CSS_DPI / DPI),
        }
    return {"kind": "table", "title": part.title, "caption": part.caption, **_table(part)}


def _table(table: Table) -> dict[str, Any]:
    columns = [[row[index] for row in table.rows] for index in range(len(table.columns))]
    numeric = [is_numeric_column(column) for column in columns]
    aligned = [
        align_decimals(column) if is_number and not any("±" in text for text in column) else column
        for column, is_number in zip(columns, numeric, strict=True)
    ]
    rows = [list(zip(cells, numeric, strict=True)) for cells in zip(*aligned, strict=True)]
    return {"columns": list(zip(table.columns, numeric, strict=True)), "rows": rows}


def _aligned(rows: list[dict[str, Any]], names: Sequence[str]) -> list[dict[str, Any]]:
    """Return the rows with the named columns padded to one decimal point."""
    columns: Mapping[str, list[str]] = {
        name: align_decimals([str(row[name]) for row in rows]) for name in names
    }
    return [
        {**row, **{name: columns[name][index] for name in names}} for index, row in enumerate(rows)
    ]


def verdict_words(decision: Decision) -> str:
    """Return a decision in a few words."""
    if decision.detail is not None:
        return DETAILS.get(decision.detail, decision.detail)
    return VERDICTS[decision.verdict]


def _moment(text: str) -> str:
    """Return an ISO 8601 time in UTC as people read it."""
    for ending in ("+00:00", "Z"):
        text = text.removesuffix(ending)
    return text.replace("T", " ", 1)
