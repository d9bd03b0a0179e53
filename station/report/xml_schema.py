"""An XML document held against the schema that a user supplies; nothing is fetched."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import islice
from pathlib import Path

from station.errors import InputError, reason_of

MAX_FAULTS = 5


def refuse_invalid(xml: bytes, schema: Path) -> None:
    """Raise InputError where a document does not follow a schema, or that is none.

    Schemas that it imports are looked for beside it, by the namespace that they declare.
    """
    import xmlschema

    beside = {}
    for path in sorted(schema.parent.glob("*.xsd")):
        try:
            space = ET.parse(path).getroot().get("targetNamespace")
        except (ET.ParseError, OSError):
            continue
        if space and path != schema:
            beside[space] = str(path)
    try:
        rules = xmlschema.XMLSchema(str(schema), locations=beside, allow="local")
    except (xmlschema.XMLSchemaException, ET.ParseError, OSError, ValueError) as error:
        raise InputError(
            f"{schema} is no XML schema that can be used: {first_line(error)}"
        ) from None
    faults = islice(rules.iter_errors(xml.decode()), MAX_FAULTS)
    sentences = [
        f"the certificate does not follow {schema.name} at {fault.path}: {fault.reason}"
        for fault in faults
    ]
    if sentences:
        raise InputError("\n".join(sentences))


def first_line(error: BaseException) -> str:
    """Return the first line of what a library says."""
    return (reason_of(error).splitlines() or [""])[0].rstrip(" :")
