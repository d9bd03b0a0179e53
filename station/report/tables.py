"""The results for other programs: a CSV table, and JUnit XML.

JUnit is for a test system that collects verdicts: one test case for each result that has a limit.
Outside its limit is a failure; what the data cannot determine, or the decision rule cannot decide,
is an error, and so are a run that did not go through all its steps and a bench that could not be
proven safe: a test system that reads the file is green only where `station run` ended with exit
code 0.
"""

from __future__ import annotations

import csv
import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from station.results import LIMIT_WITHOUT_RESULT, UNSAFE, WRONG_EXCITATION

if TYPE_CHECKING:
    from station.record.folder import RunFolder
    from station.results import ResultDocument


COLUMNS = (
    "procedure",
    "name",
    "axis",
    "value",
    "unit",
    "standard_uncertainty",
    "coverage_factor",
    "expanded_uncertainty",
    "degrees_of_freedom",
    "method",
    "limit_min",
    "limit_max",
    "limit_max_abs",
    "verdict",
    "decision",
    "as_published",
    "as_published_unit",
    "as_published_method",
)


def published_by_key(document: ResultDocument) -> dict[tuple[str, str | None], dict[str, Any]]:
    """Return what the source document's own formula gave, by name and axis of the result."""
    return {
        (published.name, published.axis): published.to_data() for published in document.published
    }


def csv_of(document: ResultDocument) -> str:
    """Return the results as CSV with a header; what is null stays empty.

    Numbers have the digits that bring back the same number, uncertainties are in the value's unit.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for row in rows_of(document):
        writer.writerow({name: no_formula(value) for name, value in row.items()})
    return text.getvalue()


def rows_of(document: ResultDocument) -> Iterator[dict[str, Any]]:
    """Yield each result with its limit and its published value, by the names of `COLUMNS`."""
    published = published_by_key(document)
    for result in document.results:
        data = result.to_data()
        other = published.get((data["name"], data["axis"]), {})
        yield {
            **data,
            "procedure": document.procedure,
            **{f"limit_{name}": value for name, value in (data["limit"] or {}).items()},
            "as_published": other.get("value"),
            "as_published_unit": other.get("unit"),
            "as_published_method": other.get("method"),
        }


def no_formula(value: object) -> object:
    """Return a cell that a spreadsheet does not take for a formula; numbers stay as they are."""
    return f"'{value}" if isinstance(value, str) and value[:1] in tuple("=+-@\t\r") else value


INCOMPLETE = "run-not-complete"
DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>\n'
NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 cannot hold, not even escaped."""


def junit_of(folder: RunFolder, document: ResultDocument) -> str:
    """Return the results of a run as JUnit XML; the suite's time is the run's bench time in s."""
    facts = folder.run_facts()
    bench_time_s = folder.events[-1].time_s if folder.events else 0.0
    suite = ET.Element("testsuite", name=document.procedure)
    suite.set("timestamp", str(facts["started_utc"])[:19])
    suite.set("hostname", clean(facts["host"]))
    suite.set("time", f"{bench_time_s:.3f}")
    add_properties(
        suite,
        {
            "verdict": document.verdict,
            "station": facts["station"],
            "results_without_limit": sum(result.limit is None for result in document.results),
        },
    )
    published = published_by_key(document)
    for result in document.results:
        data = result.to_data()
        if data["limit"] is not None:
            other = published.get((data["name"], data["axis"]))
            add_case(suite, document.procedure, data, other)
    for flag in document.flags:
        if flag.code == UNSAFE:
            name = f"{UNSAFE} {flag.details['instrument']}"
            add_error(suite, document.procedure, name, flag.code, flag.message)
        if flag.code == WRONG_EXCITATION:
            coil = f"{WRONG_EXCITATION} {flag.details['coil']}"
            add_error(suite, document.procedure, coil, flag.code, flag.message)
        if flag.code == LIMIT_WITHOUT_RESULT:
            name = f"{flag.details['name']} {flag.axis or ''}".strip()
            add_error(suite, document.procedure, name, flag.code, flag.message)
    if not folder.state.measured:
        sentence = "the run did not go through all its steps; what it measured is evaluated here"
        add_error(suite, document.procedure, INCOMPLETE, INCOMPLETE, sentence)
    suite.set("tests", str(len(suite.findall("testcase"))))
    suite.set("failures", str(len(suite.findall("testcase/failure"))))
    suite.set("errors", str(len(suite.findall("testcase/error"))))
    suite.set("skipped", "0")
    root = ET.Element("testsuites")
    root.append(suite)
    ET.indent(root)
    return f"{DECLARATION}{ET.tostring(root, encoding='unicode')}\n"


def add_case(
    suite: ET.Element, procedure: str, data: Mapping[str, Any], published: Mapping[str, Any] | None
) -> None:
    """Add the test case of one result (an entry of `results`) with its numbers as properties."""
    name = clean(" ".join(part for part in (data["name"], data["axis"]) if part))
    case = ET.SubElement(suite, "testcase", classname=procedure, name=name)
    limit = ", ".join(f"{key} {value:g}" for key, value in data["limit"].items())
    add_properties(
        case,
        {
            "value": data["value"],
            "unit": data["unit"],
            "u": data["standard_uncertainty"],
            "U": data["expanded_uncertainty"],
            "k": data["coverage_factor"],
            "degrees_of_freedom": data["degrees_of_freedom"],
            "limit": limit,
            "as_published": published["value"] if published else None,
        },
    )
    if data["verdict"] == "pass":
        return
    measured = "undetermined" if data["value"] is None else in_words(data)
    sentence = clean(f"{name}: {measured}, limit {limit} {data['unit']}")
    if data["verdict"] == "fail":
        ET.SubElement(case, "failure", type="outside-limit", message=sentence)
    else:
        why = data.get("decision") or "undetermined"
        ET.SubElement(case, "error", type=why, message=f"{sentence}: {why}")


def add_error(suite: ET.Element, procedure: str, name: str, code: str, message: str) -> None:
    """Add a test case that is no result: something that keeps the run from counting as passed."""
    case = ET.SubElement(suite, "testcase", classname=procedure, name=clean(name))
    ET.SubElement(case, "error", type=code, message=clean(message))


def in_words(data: Mapping[str, Any]) -> str:
    """Return value, expanded uncertainty and unit of a result as text."""
    expanded = data["expanded_uncertainty"]
    return f"{data['value']:.6g}{'' if expanded is None else f' ± {expanded:.2g}'} {data['unit']}"


def add_properties(element: ET.Element, named: Mapping[str, Any]) -> None:
    """Add properties; what is None is left out."""
    properties = ET.SubElement(element, "properties")
    for name, value in named.items():
        if value is not None:
            ET.SubElement(properties, "property", name=name, value=clean(value))


def clean(value: object) -> str:
    """Return a value as text that XML can hold."""
    return NOT_XML.sub("�", str(value))
