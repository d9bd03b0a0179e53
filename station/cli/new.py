"""`station new`: a plan, a bench file or a procedure that works, to change into one's own."""

from __future__ import annotations

import keyword
import re
from collections.abc import Mapping
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template

from station import registry
from station.console import tell
from station.errors import InputError
from station.files.faults import meant, not_there
from station.files.lookup import BENCHES, PLANS, available, find
from station.speech import show

NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
USUAL = "rlg-magnetic-sensitivity"
"""The plan that a new plan extends and a new bench is written for."""


def template(name: str, values: Mapping[str, str]) -> str:
    """Return the text of a template of the package with its placeholders filled."""
    text = files("station").joinpath("templates", f"{name}.template").read_text(encoding="utf-8")
    return Template(text).substitute(values)


def write_new(kind: str, name: str, base: str | None = None) -> None:
    """Write what a name stands for, print each file, and say what comes next.

    A new plan extends the plan `base`. Raises InputError, before anything is written, where the
    name is no name or is taken.
    """
    if base is not None and kind != "plan":
        raise InputError(f"--extends is for a plan; write `station new {kind} {name}`")
    if not NAME.fullmatch(name):
        raise InputError(
            f"'{name}' is no name for this: write small letters, digits and single hyphens, such "
            "as 'room-3'"
        )
    if kind == "plan":
        texts, following = plan(name, base or USUAL)
    else:
        texts, following = bench(name) if kind == "bench" else procedure(name)
    for path in texts:
        if path.exists() or path.is_symlink():
            raise InputError(f"{path} is there already, nothing was written; choose another name")
    for path, text in texts.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("x", encoding="utf-8", newline="\n") as file:
                file.write(text)
        except OSError as error:
            raise InputError(f"{path} cannot be written: {error.strerror or error}") from error
        show(f"written: {path}")
    tell("next:\n" + "\n".join(f"  {line}" for line in following))


def plan(name: str, base: str) -> tuple[dict[Path, str], list[str]]:
    """Return a plan that extends another one, whose values stand in it as comments."""
    plans = free(PLANS, "plan", name)
    if base not in plans:
        what, hint = not_there("plan", base, plans)
        raise InputError(f"--extends: {meant(what, hint)}")
    own = find(PLANS, base).read_text(encoding="utf-8", errors="replace")
    stated = own[own.find("\nparameters:") + 1 :].splitlines() if "\nparameters:" in own else []
    values = {"name": name, "base": base, "parameters": "\n".join(map(commented, stated))}
    return (
        {Path("config", PLANS, f"{name}.yaml"): template("plan.yaml", values).rstrip() + "\n"},
        ["change it", f"station validate {name}", f"station run {name} --dry-run"],
    )


def commented(line: str) -> str:
    """Return a line as a comment."""
    return f"# {line}".rstrip()


def bench(name: str) -> tuple[dict[Path, str], list[str]]:
    """Return a bench file whose addresses, serial numbers and limits a person fills in."""
    free(BENCHES, "bench", name)
    return (
        {Path("config", BENCHES, f"{name}.yaml"): template("bench.yaml", {"name": name})},
        [
            "fill in each line with FILL IN",
            f"station validate {USUAL} --bench {name}",
            f"station identify {name}",
        ],
    )


def procedure(name: str) -> tuple[dict[Path, str], list[str]]:
    """Return a package with a procedure, its entry points, a plan and a test."""
    package = name.replace("-", "_")
    if name in registry.names(registry.PROCEDURES):
        raise InputError(f"there is a procedure '{name}' already; choose another name")
    if keyword.iskeyword(package) or find_spec(package) is not None:
        raise InputError(f"Python has a module '{package}' already; choose another name")
    values = {"name": name, "project": name, "package": package, "plan": f"{name}.yaml"}
    names = {
        "pyproject.toml": "pyproject.toml",
        "package/__init__.py": f"{package}/__init__.py",
        "package/steps.py": f"{package}/steps.py",
        "package/evaluate.py": f"{package}/evaluate.py",
        "plan.yaml": f"{name}.yaml",
        "test_package.py": f"test_{package}.py",
    }
    texts = {
        Path(name, path): template(f"procedure/{source}", values) for source, path in names.items()
    }
    return texts, [
        f"pip install -e {name}",
        f"station run {name}/{name}.yaml --non-interactive",
        f"pytest {name}",
        "put your method in place of the coil constant that it measures",
    ]


def free(kind: str, word: str, name: str) -> list[str]:
    """Return the names of all plans or benches; InputError where a name is among them."""
    names = dict(available(kind))
    if name in names:
        raise InputError(
            f"there is a {word} '{name}' already ({names[name]}), nothing was written; choose "
            "another name"
        )
    return list(names)
