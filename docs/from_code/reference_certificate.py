"""The checklist of a certificate: each clause of ISO/IEC 17025 and where its field comes from."""

from __future__ import annotations

from tables import table

from station.report.certificate_fields import MANDATORY

CLAUSES: tuple[tuple[str, str, str | tuple[str, ...]], ...] = (
    ("7.8.2.1 a", "a title", ("title",)),
    ("7.8.2.1 b", "name and address of the laboratory", ("laboratory", "address")),
    ("7.8.2.1 c", "where the work was done", ("location",)),
    (
        "7.8.2.1 d",
        "a number on every page, an end that can be recognised",
        ("number",),
    ),
    ("7.8.2.1 e", "name of the customer, how to reach them", ("customer", "customer_address")),
    ("7.8.2.1 e", "the order", ("order",)),
    ("7.8.2.1 f", "the method", ("method", "work_instruction")),
    ("7.8.2.1 g", "the device, and its condition", ("device", "condition")),
    ("7.8.2.1 h", "the date of receipt", ("received",)),
    ("7.8.2.1 i", "the dates of the work", ("tested",)),
    ("7.8.2.1 j", "the date of issue", ("issued",)),
    ("7.8.2.1 k", "the plan and method of sampling", "none: each device is measured itself"),
    ("7.8.2.1 l", "that the results relate to this item only", "a fixed statement"),
    ("7.8.2.1 m", "results with their units", ("results",)),
    ("7.8.2.1 n", "deviations from the method", "`deviations` of the plan; none: says so"),
    ("7.8.2.1 o", "who authorises it", ("signatories",)),
    ("7.8.2.1 p", "results of external providers", "none: a run measures all that it says"),
    ("7.8.2.2", "what the customer supplied", "not marked: say so in `deviations`"),
    (
        "7.8.4.1 a",
        "the uncertainty of each result in its unit",
        "the run; DRAFT while an input of it is stated by nobody",
    ),
    ("7.8.4.1 b", "the conditions of the measurement", ("ambient",)),
    ("7.8.4.1 c", "how the results are traceable", ("traceability",)),
    ("7.8.4.1 d", "results before and after an adjustment", "none: a run adjusts no device"),
    ("7.8.4.1 e", "a statement of conformity where one is asked for", "`limits` of the plan"),
    ("7.8.4.1 f", "opinions and interpretations", "none is printed"),
    ("7.8.4.2", "sampling before a calibration", "none: each device is measured itself"),
    ("7.8.4.3", "no interval of calibration, unless agreed", "none is printed"),
    ("7.8.6.1", "the decision rule", "`decision_rule` of the plan"),
    (
        "7.8.6.2",
        "results, limits and rule that a statement holds for",
        "the columns Limit and Decision of the results",
    ),
    (
        "7.8.8",
        "an amended certificate is known as such",
        "`--replaces NUMBER --reason TEXT` of `station report --issue`",
    ),
)
"""Clause, what it asks for, and the fields that hold it, or where it comes from in words."""


def certificate_fields() -> str:
    """Return the checklist as a table; every mandatory field is in it."""
    named = [name for _, _, fields in CLAUSES if not isinstance(fields, str) for name in fields]
    assert sorted(named) == sorted(MANDATORY), set(MANDATORY) ^ {*named}
    rows = [
        [clause, asks, where, ""]
        if isinstance(where, str)
        else [clause, asks, "; ".join(dict.fromkeys(MANDATORY[name][2] for name in where)), "yes"]
        for clause, asks, where in CLAUSES
    ]
    return table(("clause", "asks for", "comes from", "DRAFT without it"), rows)
