"""Put a plan together: the file, the plans it extends, what `--set` changes, and the vars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from station.files.faults import Fault
from station.files.plan.extends import EXTENDS, layers_of, merged
from station.files.plan.overrides import override
from station.files.plan.vars import VARS, fill_in, references
from station.files.yaml.document import Document


@dataclass(frozen=True)
class Composition:
    """A plan with nothing left to fill in, the files it was made from, and what was wrong."""

    document: Document
    bases: tuple[Path, ...]
    faults: list[Fault]


def compose(plan: Document, overrides: Sequence[str] = ()) -> Composition:
    """Return the plan with its bases merged, `--set` applied and vars filled in.

    Every value keeps the place where it stands: its file and line, or the `--set`. `text` and
    `path` stay those of the plan itself. Raises FaultList when a base cannot be read.
    """
    alone = EXTENDS not in plan.data and VARS not in plan.data
    if alone and not overrides and "${" not in plan.text:
        return Composition(plan, (), [])
    layers = layers_of(plan)
    document = merged(layers)
    faults = override(document, overrides)
    faults += fill_in(document, references([*layers, document]))
    return Composition(document, tuple(layer.path for layer in layers[1:]), faults)
