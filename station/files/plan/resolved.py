"""The resolved plan as YAML: every value, and beside it where it comes from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any
from unicodedata import east_asian_width

from station.files.faults import dotted
from station.files.plan.composition import OPTION
from station.files.yaml.document import Where, leaves, yaml_text
from station.files.yaml.reading import read_yaml_text

if TYPE_CHECKING:
    from station.files.plan.model import Plan

DEFAULT = "default"
WIDEST_ALIGNED = 60


def origins(plan: Plan, *, short: bool = False) -> dict[Where, str]:
    """Return where each value of the resolved plan comes from, by path.

    `my-plan.yaml:12`, `default`, `--set`, or `vars.drive, my-plan.yaml:4`; `short` leaves the
    folders of the files out where the names tell them apart.
    """
    files = [str(path) for path in (plan.path, *plan.bases)]
    names = [Path(file).name for file in files]
    if not short or len(set(names)) < len(names):
        names = files
    shown = dict(zip(files, names, strict=True))
    return {where: _origin(plan, where, shown) for where, _ in leaves(plan.to_yaml_data())}


def _origin(plan: Plan, where: Where, shown: dict[str, str]) -> str:
    mark = plan.document.positions.get(where)
    if mark is None:
        return DEFAULT
    file = mark.file or str(plan.path)
    place = OPTION if file == OPTION else f"{shown.get(file, file)}:{mark.line}"
    return f"vars.{mark.var}, {place}" if mark.var else place


def resolved_text(plan: Plan) -> str:
    """Return the resolved plan as YAML that can be read again, each origin as a comment."""
    text = yaml_text(plan.to_yaml_data())
    placed = read_yaml_text(text, plan.path).positions
    comments = {placed[where].line: origin for where, origin in origins(plan, short=True).items()}
    lines = text.splitlines()
    widths = [_width(lines[number - 1]) for number in comments]
    column = max((width for width in widths if width <= WIDEST_ALIGNED), default=0) + 2
    for number, origin in comments.items():
        line = lines[number - 1]
        lines[number - 1] = line + " " * max(column - _width(line), 2) + f"# {origin}"
    head = [f"# {plan.path}, resolved", *(f"# extends {base}" for base in plan.bases)]
    head += [f"# {OPTION} {' '.join(given.split())}" for given in plan.overrides]
    return "\n".join([*head, *lines, ""])


def resolved_data(plan: Plan) -> dict[str, Any]:
    """Return the resolved plan and its origins by dotted path, for `--json`."""
    return {
        "plan": str(plan.path),
        "extends": [str(base) for base in plan.bases],
        "set": list(plan.overrides),
        "values": plan.to_yaml_data(),
        "origins": {dotted(where): origin for where, origin in origins(plan).items()},
    }


def _width(line: str) -> int:
    """Return the columns a line takes; East Asian characters take two."""
    return sum(2 if east_asian_width(char) in "WF" else 1 for char in line)
