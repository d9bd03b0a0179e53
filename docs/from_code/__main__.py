"""Write what the reference pages take from the code into them; a test holds them to it.

python docs/from_code

What stands in a page between `<!-- from code: NAME -->` and `<!-- end of NAME -->` is what the
function behind NAME returns.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import reference_bad_input
import reference_certificate
import reference_faults
import reference_formats
import reference_instruments
import reference_keys
import reference_roles
import reference_verbs
import templates

DOCS = Path(__file__).parents[1]
PLACE = re.compile(
    r"^<!-- from code: ([a-z-]+) -->\n(?:.*?^<!-- end of \1 -->\n)?", re.MULTILINE | re.DOTALL
)
MAKERS: dict[str, Callable[[], str]] = {
    "bad-input": reference_bad_input.bad_input,
    "plan-keys": reference_keys.plan_keys,
    "procedures": reference_keys.procedures,
    "bench-keys": reference_keys.bench_keys,
    "drivers": reference_keys.drivers,
    "faults": reference_faults.faults,
    "instruments": reference_instruments.instruments,
    "roles": reference_roles.roles,
    "safe-states": reference_roles.safe_states,
    "dataset-keys": reference_keys.dataset_keys,
    "verbs": reference_verbs.verbs,
    "exit-codes": reference_verbs.exit_codes,
    "units": reference_verbs.units,
    "certificate-fields": reference_certificate.certificate_fields,
    "flags": reference_formats.flags,
    "result-keys": reference_formats.result_keys,
    "result-example": reference_formats.result_example,
    "run-files": reference_formats.run_files,
    "run-events": reference_formats.run_events,
    **templates.MAKERS,
}


def filled(text: str) -> str:
    """Return a page's text with what it takes from the code as the code is now."""

    def fill(place: re.Match[str]) -> str:
        name = place.group(1)
        return f"<!-- from code: {name} -->\n\n{MAKERS[name]().strip()}\n\n<!-- end of {name} -->\n"

    return PLACE.sub(fill, text)


def pages() -> list[Path]:
    """Return the pages that take something from the code."""
    every = sorted(DOCS.rglob("*.md"))
    return [page for page in every if PLACE.search(page.read_text(encoding="utf-8"))]


def main() -> None:
    """Write every page."""
    for page in pages():
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
