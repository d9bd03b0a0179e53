"""The certificate of a run as a digital calibration certificate: DCC 3.3 (PTB), units by the D-SI.

It says what the printed one says, in English: the digits of value and U are the same, save where
a unit is converted into one of the SI. What makes the printed one a draft stands first in the
statements of this one, and its identifier says so. Source: PTB, "DCC schema 3.3.0".
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from station.decision import Limit
from station.report.certificate import (
    NO_DEVIATION,
    ONLY_ITEMS,
    REPRODUCTION,
    USED_ONLY,
    is_decided,
)
from station.report.certificate_curves import Curve, Curves
from station.report.certificate_fields import Certificate, messages
from station.report.certificate_results import convention_row, name_of, probability_text
from station.report.html import verdict_words
from station.report.numbers import format_limit, format_with_uncertainty
from station.report.si_units import si_unit
from station.report.tables import DECLARATION, clean
from station.uncertainty import COVERAGE_PERCENT

if TYPE_CHECKING:
    from station.results import Result

DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
XSI = "http://www.w3.org/2001/XMLSchema-instance"
VERSION = "3.3.0"
SCHEMA_PLACE = f"{DCC} https://ptb.de/dcc/v{VERSION}/dcc.xsd"
DRAFT = "DRAFT-"
COUNTRY_NOT_STATED = "ZZ"
"""A code that ISO 3166-1 leaves to its users."""
NO_COUNTRY = "The country of the laboratory is missing: `laboratory.country` of the bench file."
NOT_STATED = "not stated"
RELEASE = re.compile(r"\d{1,3}(\.\d{1,3}){0,3}")
CONFORMITY: Mapping[str, str] = {
    "pass": "pass",
    "fail": "fail",
    "conditional-pass": "conditionalPass",
    "conditional-fail": "conditionalFail",
}
"""What the schema calls a verdict, or why it is inconclusive."""
for _prefix, _namespace in (("dcc", DCC), ("si", SI), ("xsi", XSI)):
    ET.register_namespace(_prefix, _namespace)


def dcc_of(certificate: Certificate, unissued: str = "") -> tuple[bytes, tuple[str, ...]]:
    """Return a certificate as XML, and in sentences why it is a draft.

    `unissued` says why it is not the one in force.
    """
    country = certificate.country
    lacking = (unissued, "" if country else NO_COUNTRY)
    drafts = (*certificate.draft_reasons(), *filter(None, lacking))
    root = ET.Element(f"{{{DCC}}}digitalCalibrationCertificate", schemaVersion=VERSION)
    root.set(f"{{{XSI}}}schemaLocation", SCHEMA_PLACE)
    data = _add(root, "administrativeData")
    _software(_add(data, "dccSoftware"), certificate.versions[:1])
    core = _add(data, "coreData")
    _add(core, "countryCodeISO3166_1", country or COUNTRY_NOT_STATED)
    _add(core, "usedLangCodeISO639_1", "en")
    _add(core, "mandatoryLangCodeISO639_1", "en")
    _add(core, "uniqueIdentifier", (DRAFT if drafts else "") + certificate.number)
    identified = [
        ("customer", "Order", certificate.order),
        *(("customer", name, text) for name, text in certificate.references),
        ("calibrationLaboratory", "Run", certificate.run),
        ("calibrationLaboratory", "Head of the run's log (SHA-256)", certificate.head),
    ]
    _identifications(core, identified)
    if certificate.received:
        _add(core, "receiptDate", certificate.received)
    _add(core, "beginPerformanceDate", certificate.days[0])
    _add(core, "endPerformanceDate", certificate.days[1])
    _add(core, "performanceLocation", "laboratory")
    _item(_add(_add(data, "items"), "item"), certificate)
    place = _add(data, "calibrationLaboratory")
    if certificate.accreditation:
        _add(place, "calibrationLaboratoryCode", certificate.accreditation)
    _contact(_add(place, "contact"), certificate.laboratory, certificate.address, country)
    people = _add(data, "respPersons")
    for name, function in certificate.signatories or ((NOT_STATED, ""),):
        person = _add(people, "respPerson")
        _text(_add(person, "person"), "name", name)
        if function:
            _add(person, "role", function)
        if len(people) == 1:
            _add(person, "mainSigner", "true")
    _contact(_add(data, "customer"), certificate.customer, certificate.customer_address)
    statements = _add(data, "statements")
    for reason in drafts:
        _statement(statements, f"Draft: {reason}", valid="false")
    for sentence in _sentences(certificate):
        _statement(statements, sentence)
    _measured(_add(_add(root, "measurementResults"), "measurementResult"), certificate)
    ET.indent(root)
    return f"{DECLARATION}{ET.tostring(root, encoding='unicode')}\n".encode(), drafts


def _add(parent: ET.Element, name: str, text: str | None = None, space: str = DCC) -> ET.Element:
    element = ET.SubElement(parent, f"{{{space}}}{name}")
    if text is not None:
        element.text = clean(text)
    return element


def _text(parent: ET.Element, name: str, text: str) -> ET.Element:
    element = _add(parent, name)
    _add(element, "content", text or NOT_STATED).set("lang", "en")
    return element


def _statement(parent: ET.Element, sentence: str, valid: str | None = None) -> None:
    statement = _add(parent, "statement")
    _text(statement, "declaration", sentence)
    if valid is not None:
        _add(statement, "valid", valid)


def _software(parent: ET.Element, versions: Sequence[tuple[str, str]]) -> None:
    """Add what has a release as the schema's rules take it; the rest describes the first."""
    first: ET.Element | None = None
    for name, release in versions:
        if RELEASE.fullmatch(release):
            software = _add(parent, "software")
            _text(software, "name", name)
            _add(software, "release", f"v{release}")
            first = software if first is None else first
    rest = [f"{name}: {text}" for name, text in versions if not RELEASE.fullmatch(text)]
    if first is None:
        first = _add(parent, "software")
        _text(first, "name", "station")
        _add(first, "release", "v0")
    if rest:
        _text(first, "description", "; ".join(rest))


def _identifications(parent: ET.Element, named: Sequence[tuple[str, str, str]]) -> None:
    """Add issuer, name and value of each identification that is stated."""
    stated = [each for each in named if each[2]]
    if not stated:
        return
    several = _add(parent, "identifications")
    for issuer, name, value in stated:
        identification = _add(several, "identification")
        _add(identification, "issuer", issuer)
        _add(identification, "value", value)
        _text(identification, "name", name)


def _item(item: ET.Element, certificate: Certificate) -> None:
    device = dict(certificate.device)
    _text(item, "name", device["Model"])
    notes = "; ".join(text for text in (certificate.condition, device["Notes"]) if text)
    if notes:
        _text(item, "description", notes)
    _text(_add(item, "manufacturer"), "name", device["Manufacturer"])
    _add(item, "model", device["Model"])
    serial = device["Serial number"] or NOT_STATED
    _identifications(item, [("manufacturer", "Serial number", serial)])


def _contact(contact: ET.Element, name: str, address: str, country: str | None = None) -> None:
    """Add name and address; the schema asks for an e-mail address, which nobody states."""
    _text(contact, "name", name)
    _add(contact, "eMail", NOT_STATED)
    location = _add(contact, "location")
    if country:
        _add(location, "countryCode", country)
    _text(location, "further", address)


def _sentences(certificate: Certificate) -> Iterator[str]:
    """Yield what the certificate states: deviations, flags, decision, what was left out."""
    yield from certificate.amendment
    yield from certificate.deviations or (NO_DEVIATION,)
    yield from messages(certificate.flags)
    if is_decided(certificate):
        yield f"Decision rule: {certificate.decision_rule}"
        yield f"Decision: {certificate.verdict}"
    yield from certificate.remarks
    for what, axis, value, unit in map(convention_row, certificate.conventions):
        named = " ".join(filter(None, (what, axis, value, unit if unit != "1" else "")))
        yield f"Set by convention, not measured: {named}."
    yield from certificate.assumptions
    if certificate.si_statement:
        yield certificate.si_statement
    if certificate.other_instruments:
        others = certificate.other_instruments
        listed = ", ".join(f"{name} ({model})" if model else name for name, model in others)
        yield f"{USED_ONLY}: {listed}."
    for name, digest in certificate.hashes:
        yield f"SHA-256 of {name}: {digest}"
    yield from (ONLY_ITEMS, REPRODUCTION)


def _measured(parent: ET.Element, certificate: Certificate) -> None:
    """Add method, software, instruments, conditions and results, in the schema's order."""
    _text(parent, "name", certificate.title)
    method = _add(_add(parent, "usedMethods"), "usedMethod")
    _text(method, "name", certificate.method or certificate.title)
    if certificate.cited:
        _add(method, "norm", certificate.cited)
    if certificate.work_instruction:
        _add(method, "reference", certificate.work_instruction)
    _software(_add(parent, "usedSoftware"), certificate.versions)
    if certificate.traceability:
        instruments = _add(parent, "measuringEquipments")
        for name, model, number, date, due, maker in certificate.traceability:
            instrument = _add(instruments, "measuringEquipment")
            _text(instrument, "name", name)
            _text(
                instrument, "description", f"Calibrated {date} by {maker or NOT_STATED}, due {due}"
            )
            _add(instrument, "model", model)
            _identifications(instrument, [("other", "Calibration certificate", number)])
    if certificate.room or certificate.ambient:
        _conditions(_add(parent, "influenceConditions"), certificate)
    results = _add(parent, "results")
    for result in certificate.results:
        _result(_add(results, "result"), result)
    for curves in certificate.curves:
        for curve in curves.curves:
            _curve(_add(results, "result"), curves, curve)
    if not len(results):
        nothing = _add(results, "result")
        _text(nothing, "name", certificate.title)
        _text(_add(nothing, "data"), "text", "These data determine no result.")


def _conditions(parent: ET.Element, certificate: Certificate) -> None:
    """Add what was typed of the room, then what sources of the run recorded."""
    for read in certificate.room:
        condition = _add(parent, "influenceCondition")
        _text(condition, "name", f"{read.quantity} ({read.instrument})")
        if read.value is None:
            _text(_add(condition, "data"), "text", NOT_STATED)
            continue
        quantity = _add(_add(condition, "data"), "quantity")
        _text(quantity, "name", read.quantity)
        _real(quantity, read.value, None, read.unit, read.uncertainty)
    for recorded in certificate.ambient:
        condition = _add(parent, "influenceCondition")
        _text(condition, "name", f"{recorded.quantity} ({recorded.source})")
        data = _add(condition, "data")
        for word in ("smallest", "mean", "largest"):
            quantity = _add(data, "quantity")
            _text(quantity, "name", word)
            _real(quantity, getattr(recorded, word), None, recorded.unit)


def _curve(parent: ET.Element, curves: Curves, curve: Curve) -> None:
    """Add the formula of a curve, and its values with U at temperatures where U is known."""
    _text(parent, "name", " ".join(filter(None, (curves.name, curve.axis, "over temperature"))))
    data = _add(parent, "data")
    _, names, rows, holds = next(curves.tables())
    row = rows[curves.curves.index(curve)]
    stated = "; ".join(": ".join(pair) for pair in zip(names[1:], row[1:], strict=True))
    _text(data, "text", f"{stated}. {holds}")
    if not curve.points:
        return
    name, factor = si_unit(curves.unit) or (curves.unit, 1.0)
    points = curve.points
    texts = [format_with_uncertainty(p.value * factor, p.expanded * factor) for p in points]
    _list(data, "temperature", r"\degreecelsius", [f"{p.temperature_degC:g}" for p in points])
    listed = _list(data, curves.name, name, [value for value, _ in texts])
    univariate = _add(listed, "measurementUncertaintyUnivariateXMLList", space=SI)
    uncertainty = _add(univariate, "expandedMUXMLList", space=SI)
    _add(uncertainty, "valueExpandedMUXMLList", " ".join(expanded for _, expanded in texts), SI)
    factors = " ".join(f"{point.coverage_factor:.2f}" for point in points)
    _add(uncertainty, "coverageFactorXMLList", factors, SI)
    _add(uncertainty, "coverageProbabilityXMLList", f"{COVERAGE_PERCENT / 100:g}", SI)


def _list(data: ET.Element, name: str, unit: str, values: Sequence[str]) -> ET.Element:
    """Add a list of numbers in a unit of the D-SI, and return it."""
    quantity = _add(data, "quantity")
    _text(quantity, "name", name)
    listed = _add(quantity, "realListXMLList", space=SI)
    _add(listed, "valueXMLList", " ".join(values), SI)
    _add(listed, "unitXMLList", unit, SI)
    return listed


def _result(parent: ET.Element, result: Result) -> None:
    """Add a result with its expanded uncertainty, and the statement of conformity on it."""
    estimate = result.estimate
    assert estimate.value is not None
    name = " ".join(filter(None, (name_of(result), estimate.axis)))
    _text(parent, "name", name)
    if estimate.holds_at:
        _text(parent, "description", f"at {estimate.holds_at}")
    quantity = _add(_add(parent, "data"), "quantity")
    quantity.set("refType", "basic_measuredValue")
    _text(quantity, "name", name)
    _real(quantity, estimate.value, result, estimate.unit)
    if result.limit is None:
        return
    stated = _add(_add(quantity, "measurementMetaData"), "metaData")
    likely = probability_text(result.conformity)
    words = [f"{format_limit(result.limit)} {estimate.unit}", verdict_words(result.decision)]
    if likely:
        words.append(f"probability of conformity {likely}")
    _text(stated, "declaration", ": ".join((words[0], ", ".join(words[1:]))))
    conformity = CONFORMITY.get(result.decision.detail or result.decision.verdict)
    if conformity:
        _add(stated, "conformity", conformity)
    _limits(_add(stated, "data"), result.limit, estimate.unit)


def _limits(data: ET.Element, limit: Limit, unit: str) -> None:
    for name, value in zip(("Lower limit", "Upper limit"), limit.interval(), strict=True):
        if abs(value) != float("inf"):
            quantity = _add(data, "quantity")
            _text(quantity, "name", name)
            _real(quantity, value, None, unit)


def _real(
    quantity: ET.Element, value: float, result: Result | None, unit: str, u: float | None = None
) -> None:
    """Add a number in a unit of the D-SI, or as a text where it has no such unit.

    It has the expanded uncertainty of a result, or a standard one.
    """
    combined = result.combined if result else None
    known = si_unit(unit)
    if known is None:
        texts = format_with_uncertainty(value, combined.expanded_uncertainty if combined else None)
        _text(quantity, "noQuantity", f"{' ± '.join(texts) if combined else value} {unit}")
        return
    name, factor = known
    real = _add(quantity, "real", space=SI)
    if combined is None or not combined.expanded_uncertainty:
        _add(real, "value", f"{value * factor:.15g}", SI)
        _add(real, "unit", name, SI)
        if u is not None:
            univariate = _add(real, "measurementUncertaintyUnivariate", space=SI)
            standard = _add(univariate, "standardMU", space=SI)
            _add(standard, "valueStandardMU", f"{u * factor:.15g}", SI)
        return
    shown, expanded = format_with_uncertainty(
        value * factor, combined.expanded_uncertainty * factor
    )
    _add(real, "value", shown, SI)
    _add(real, "unit", name, SI)
    univariate = _add(real, "measurementUncertaintyUnivariate", space=SI)
    uncertainty = _add(univariate, "expandedMU", space=SI)
    _add(uncertainty, "valueExpandedMU", expanded, SI)
    _add(uncertainty, "coverageFactor", f"{combined.coverage_factor:.2f}", SI)
    _add(uncertainty, "coverageProbability", f"{COVERAGE_PERCENT / 100:g}", SI)
