"""The files of `station new procedure` as the how-to shows them, in a package of a laboratory."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from station.cli.new import template

VALUES = {
    "name": "coil-constant",
    "project": "fieldlab",
    "package": "fieldlab.coil_constant",
    "plan": "coil-x.yaml",
}
SHOWN = {
    "procedure-declared": ("package/__init__.py", "fieldlab/coil_constant/__init__.py", "python"),
    "procedure-steps": ("package/steps.py", "fieldlab/coil_constant/steps.py", "python"),
    "procedure-evaluated": ("package/evaluate.py", "fieldlab/coil_constant/evaluate.py", "python"),
    "procedure-project": ("pyproject.toml", "pyproject.toml", "toml"),
    "procedure-plan": ("plan.yaml", "coil-x.yaml", "yaml"),
    "procedure-test": ("test_package.py", "test_coil_constant.py", "python"),
}


def shown(source: str, file: str, language: str) -> str:
    """Return a template as the marked block of a file."""
    text = template(f"procedure/{source}", VALUES)
    return f"<!-- file: {file} -->\n```{language}\n{text}```"


MAKERS: dict[str, Callable[[], str]] = {name: partial(shown, *what) for name, what in SHOWN.items()}
