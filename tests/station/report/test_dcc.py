"""The digital calibration certificate, opened again by pydcc and read by the standard library."""

from __future__ import annotations

import json
import re
import shutil
import sys
import types
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from station.cli.reporting import remake_report
from station.decision import Decision, Limit
from station.errors import InputError
from station.record.events import head_of_run
from station.record.folder import RESULTS, RunFolder
from station.record.layout import EXPORTS
from station.report.certificate import ambient_rows, certificate_of_run
from station.report.certificate_fields import RoomCondition
from station.report.certificate_results import result_row
from station.report.dcc import DRAFT, NO_COUNTRY, dcc_of
from station.report.revision import newest_revision
from station.report.si_units import si_unit
from station.results import Result, ResultDocument
from station.units import UNITS

SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
ORDERS: dict[str, Sequence[str]] = {
    "digitalCalibrationCertificate": ("administrativeData", "measurementResults"),
    "administrativeData": (
        *("dccSoftware", "coreData", "items", "calibrationLaboratory", "respPersons", "customer"),
        "statements",
    ),
    "coreData": (
        *("countryCodeISO3166_1", "usedLangCodeISO639_1", "mandatoryLangCodeISO639_1"),
        *("uniqueIdentifier", "identifications", "receiptDate", "beginPerformanceDate"),
        *("endPerformanceDate", "performanceLocation"),
    ),
    "item": ("name", "description", "manufacturer", "model", "identifications"),
    "identification": ("issuer", "value", "name"),
    "calibrationLaboratory": ("calibrationLaboratoryCode", "contact"),
    "contact": ("name", "eMail", "location"),
    "customer": ("name", "eMail", "location"),
    "respPerson": ("person", "role", "mainSigner"),
    "statement": ("declaration", "valid"),
    "software": ("name", "release", "description"),
    "measurementResult": (
        *("name", "usedMethods", "usedSoftware", "measuringEquipments", "influenceConditions"),
        "results",
    ),
    "usedMethod": ("name", "norm", "reference"),
    "measuringEquipment": ("name", "description", "model", "identifications"),
    "influenceCondition": ("name", "data"),
    "result": ("name", "description", "data"),
    "quantity": ("name", "noQuantity", "real", "realListXMLList", "measurementMetaData"),
    "realListXMLList": (
        *("valueXMLList", "unitXMLList"),
        "measurementUncertaintyUnivariateXMLList",
    ),
    "expandedMUXMLList": (
        *("valueExpandedMUXMLList", "coverageFactorXMLList"),
        "coverageProbabilityXMLList",
    ),
    "metaData": ("declaration", "conformity", "data"),
    "real": ("value", "unit", "measurementUncertaintyUnivariate"),
    "expandedMU": ("valueExpandedMU", "coverageFactor", "coverageProbability"),
}
"""In which order the schema 3.3.0 has the children that are written."""
OWN_SCHEMA = """<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema"
  targetNamespace="https://ptb.de/dcc" elementFormDefault="qualified">
 <xs:element name="digitalCalibrationCertificate"><xs:complexType>
  <xs:sequence><xs:any maxOccurs="{n}" processContents="skip"/></xs:sequence>
  <xs:attribute name="schemaVersion" type="xs:string"/>
 </xs:complexType></xs:element></xs:schema>"""


@pytest.fixture(scope="module")
def run(two_axes_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("digital") / two_axes_run.name
    return Path(shutil.copytree(two_axes_run, place))


def document_of(run: Path) -> ResultDocument:
    revision = newest_revision(RunFolder(run))
    assert revision is not None
    return revision.document


def root_of(run: Path, *results: Result) -> ET.Element:
    document = document_of(run)
    if results:
        document = replace(document, results=results)
    return ET.fromstring(dcc_of(certificate_of_run(RunFolder(run), document))[0])


def texts(root: ET.Element, path: str) -> list[str]:
    return [element.text or "" for element in root.findall(path, SPACES)]


def opened_by_pydcc(data: bytes, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a certificate as pydcc has it, without what it needs for signatures and schemas.

    Its certvalidator cannot be imported beside OpenSSL 3.0.10 and later, and it fetches schemas.
    """
    validator: Any = types.ModuleType("certvalidator")
    validator.CertificateValidator = validator.ValidationContext = validator.errors = object
    monkeypatch.setitem(sys.modules, "certvalidator", validator)
    import dcc.dcc

    monkeypatch.setattr(dcc.dcc, "DCCXMLValidator", object)
    return dcc.dcc.DCC(byte_array=data)


def test_pydcc_opens_it_with_the_values_and_uncertainties_of_the_certificate(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    remake_report(run, "dcc", "certificate")
    read = opened_by_pydcc((run / EXPORTS / "certificate.dcc.xml").read_bytes(), monkeypatch)
    assert read.is_loaded() and read.version() == "3.3.0" and read.mandatory_language() == "en"
    printed = certificate_of_run(RunFolder(run), document_of(run))
    assert read.uid() == DRAFT + printed.number
    paths = read.get_calibration_results("xpath")
    assert len(paths) >= len(printed.results)
    values = texts(read.root, ".//dcc:result/dcc:data/dcc:quantity/si:real/si:value")
    expanded = texts(read.root, ".//si:valueExpandedMU")
    shown = [row[2:4] for row in map(result_row, printed.results)]
    assert shown == list(zip(values, expanded, strict=True))


def test_children_are_in_the_order_of_the_schema(run: Path) -> None:
    for element in root_of(run).iter():
        order = ORDERS.get(element.tag.rpartition("}")[2])
        if order is not None:
            ranks = [order.index(child.tag.rpartition("}")[2]) for child in element]
            assert ranks == sorted(ranks), element.tag


def test_a_simulated_run_is_a_draft_that_names_every_reason(run: Path) -> None:
    root = root_of(run)
    reasons = certificate_of_run(RunFolder(run), document_of(run)).draft_reasons()
    drafts = [
        statement.findtext("dcc:declaration/dcc:content", namespaces=SPACES)
        for statement in root.findall(".//dcc:statement", SPACES)
        if statement.findtext("dcc:valid", namespaces=SPACES) == "false"
    ]
    assert drafts == [f"Draft: {reason}" for reason in (*reasons, NO_COUNTRY)]
    assert texts(root, ".//dcc:uniqueIdentifier")[0].startswith(DRAFT)


def test_the_head_of_the_log_the_software_and_the_instruments_are_there(run: Path) -> None:
    root = root_of(run)
    assert head_of_run(run) in texts(root, ".//dcc:identification/dcc:value")
    assert "station" in texts(root, ".//dcc:usedSoftware/dcc:software/dcc:name/dcc:content")
    releases = texts(root, ".//dcc:software/dcc:release")
    assert all(re.fullmatch(r"[a-zA-Z]( )?(\d{1,3}\.){0,3}\d{1,3}", text) for text in releases)
    assert all(element.text or len(element) for element in root.iter()), "none is empty"
    printed = certificate_of_run(RunFolder(run), document_of(run))
    names = texts(root, ".//dcc:measuringEquipment/dcc:name/dcc:content")
    assert names == [row[0] for row in printed.traceability] and names
    conditions = texts(root, ".//dcc:influenceCondition/dcc:data/dcc:quantity/si:real/si:value")
    assert [f"{float(text):.2f}" for text in conditions] == [
        text for row in ambient_rows(printed) for text in row[2:5]
    ]


@pytest.mark.parametrize(
    ("decision", "conformity"),
    [
        (Decision("pass"), ["pass"]),
        (Decision("fail"), ["fail"]),
        (Decision("inconclusive", "conditional-pass"), ["conditionalPass"]),
        (Decision("inconclusive", "conditional-fail"), ["conditionalFail"]),
        (Decision("inconclusive", "wrong-excitation"), []),
    ],
)
def test_a_decision_is_a_statement_of_conformity_with_its_limits(
    decision: Decision, conformity: list[str], run: Path
) -> None:
    first = replace(document_of(run).results[0], decision=decision, limit=Limit(max_abs=0.1))
    root = root_of(run, first)
    assert texts(root, ".//dcc:metaData/dcc:conformity") == conformity
    assert texts(root, ".//dcc:metaData/dcc:data/dcc:quantity/si:real/si:value") == ["-0.1", "0.1"]


def test_g_is_converted_and_what_is_not_determined_is_left_out_by_a_sentence(run: Path) -> None:
    first, second = document_of(run).results
    assert first.combined is not None
    scale = replace(first.estimate, name="K1", axis="IA", value=2.0, unit="V/g")
    combined = replace(first.combined, expanded_uncertainty=0.01, coverage_factor=2.0)
    nothing = replace(second.estimate, value=None)
    root = root_of(
        run,
        replace(first, estimate=scale, combined=combined, limit=None),
        replace(second, estimate=nothing, combined=None, limit=None),
    )
    real = root.find(".//dcc:result/dcc:data/dcc:quantity/si:real", SPACES)
    assert real is not None
    assert "".join(real.itertext()).split() == [
        *("0.2039", r"\volt\metre\tothe{-1}\second\tothe{2}", "0.0010", "2.00", "0.95")
    ]
    left_out = "Not determined by these data, and so not stated: magnetic sensitivity of axis LA."
    assert left_out in texts(root, ".//dcc:declaration/dcc:content")


def test_it_says_what_the_printed_one_does_of_curves_switch_ons_the_room_and_the_method(
    run: Path,
) -> None:
    first, second = document_of(run).results
    assert first.combined is not None
    heat = [0.0, 20.0, 40.0]
    extra = {
        "model": {"basis": "chebyshev", "domain": [0.0, 40.0], "coefficients": [10.0, -5.0]},
        "band": {
            "temperature_degC": heat,
            "standard_uncertainty": [0.1] * 3,
            "expanded_uncertainty": [0.2] * 3,
        },
    }
    curve = replace(first.estimate, name="bias", unit="mg", value=10.0, extra=extra)
    several = replace(second.estimate, extra={"switch_ons": 3})
    results = (replace(first, estimate=curve), replace(second, estimate=several))
    document = replace(document_of(run), results=results)
    room = RoomCondition("temperature", 21.5, 0.2, "°C", "Testo 622", "K-118", "2030-01-31", "A.")
    certificate = replace(
        certificate_of_run(RunFolder(run), document),
        room=(room, replace(room, quantity="relative humidity", value=None)),
        cited="GB 1234",
    )
    root = ET.fromstring(dcc_of(certificate)[0])
    assert texts(root, ".//dcc:usedMethod/dcc:norm") == ["GB 1234"]
    condition, untyped = root.findall(".//dcc:influenceCondition", SPACES)[:2]
    assert "".join(condition.itertext()).split()[-3:] == ["21.5", r"\degreecelsius", "0.2"]
    assert "".join(untyped.itertext()).split()[-2:] == ["not", "stated"]
    names = texts(root, ".//dcc:result/dcc:name/dcc:content")
    assert names[-2:] == [
        "magnetic sensitivity of these 3 switch-ons LA",
        "bias IA over temperature",
    ]
    formula, values = certificate.curves[0].tables()
    (text,) = texts(root, ".//dcc:result/dcc:data/dcc:text/dcc:content")
    assert all(part in text for part in formula[2][0][1:3])
    temperatures, listed = texts(root, ".//si:valueXMLList")
    expanded = texts(root, ".//si:valueExpandedMUXMLList")[0].split()
    assert temperatures.split() == [row[0] for row in values[2]]
    # mg are converted into m/s², with U in proportion.
    ratios = [float(x) / float(row[1]) for x, row in zip(listed.split(), values[2], strict=True)]
    assert ratios == pytest.approx([9.80665e-3] * len(ratios), rel=5e-3)
    assert [float(x) for x in expanded] == pytest.approx([0.2 * 9.80665e-3] * len(ratios), rel=0.03)
    for element in root.iter():
        order = ORDERS.get(element.tag.rpartition("}")[2], ())
        ranks = [order.index(child.tag.rpartition("}")[2]) for child in element if order]
        assert ranks == sorted(ranks), element.tag


def test_every_unit_of_the_station_has_a_d_si_unit() -> None:
    assert all(si_unit(unit) for unit in UNITS)
    assert si_unit("deg/h/sqrt(h)") == (r"\degree\hour\tothe{-1.5}", 1.0)
    assert si_unit("deg/h/(degC/min)") == (
        r"\degree\hour\tothe{-1}\kelvin\tothe{-1}\minute",
        1.0,
    )
    assert si_unit("counts") is None


def test_a_schema_of_the_user_is_held_against_it(run: Path, tmp_path: Path) -> None:
    schema = tmp_path / "dcc.xsd"
    schema.write_text(OWN_SCHEMA.format(n="2"), encoding="utf-8")
    remake_report(run, "dcc", "report", schema=schema)
    schema.write_text(OWN_SCHEMA.format(n="1"), encoding="utf-8")
    with pytest.raises(InputError, match=r"the certificate does not follow dcc.xsd at /dcc:"):
        remake_report(run, "dcc", "report", schema=schema)
    for text in ("", "<a/>"):
        schema.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=r"dcc.xsd is no XML schema that can be used"):
            remake_report(run, "dcc", "report", schema=schema)
    with pytest.raises(InputError, match="csv has no schema; leave --schema out"):
        remake_report(run, "csv", "report", schema=schema)


def test_results_in_it_are_those_of_the_results_file(run: Path) -> None:
    results = json.loads((run / RESULTS).read_text(encoding="utf-8"))["results"]
    factors = texts(root_of(run), ".//si:coverageFactor")
    assert factors == [f"{result['coverage_factor']:.2f}" for result in results]
