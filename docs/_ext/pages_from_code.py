"""Fill the reference pages from the code when the documentation is built.

A line `<!-- from code: NAME -->` in a page is replaced by what the function behind NAME returns.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import reference_bad_input
import reference_faults
import reference_formats
import reference_keys
import reference_safety
import reference_verbs
from sphinx.application import Sphinx

PLACE = re.compile(r"^<!-- from code: ([a-z-]+) -->$", re.MULTILINE)
MAKERS: dict[str, Callable[[], str]] = {
    "bad-input": reference_bad_input.bad_input,
    "plan-keys": reference_keys.plan_keys,
    "procedures": reference_keys.procedures,
    "bench-keys": reference_keys.bench_keys,
    "drivers": reference_keys.drivers,
    "watched-quantities": reference_keys.watched_quantities,
    "faults": reference_faults.faults,
    "safe-states": reference_safety.safe_states,
    "dataset-keys": reference_keys.dataset_keys,
    "verbs": reference_verbs.verbs,
    "exit-codes": reference_verbs.exit_codes,
    "units": reference_verbs.units,
    "flags": reference_formats.flags,
    "result-keys": reference_formats.result_keys,
    "result-example": reference_formats.result_example,
    "run-files": reference_formats.run_files,
    "run-events": reference_formats.run_events,
}


def filled(text: str) -> str:
    """Return a page's text with its places filled."""
    return PLACE.sub(lambda found: MAKERS[found.group(1)](), text)


def fill(app: Sphinx, page: str, content: list[str]) -> None:
    """Fill the places of a page that Sphinx is about to read."""
    content[0] = filled(content[0])


def setup(app: Sphinx) -> dict[str, Any]:
    """Take part in the build."""
    app.connect("source-read", fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
