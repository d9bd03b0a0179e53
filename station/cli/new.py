"""`station new`: a plan, bench, procedure or driver that works, to change into one's own."""

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
ENTRY = re.compile(r"^  gaussmeter:\n(?:(?: {4,}.*)?\n)*", re.MULTILINE)
"""The gaussmeter of a bench file."""
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
            f"'{name}' is no name for this: write a small letter, then small letters, digits and "
            "single hyphens, such as 'room-3'"
        )
    if kind == "plan":
        texts, following = plan(name, base or USUAL)
    else:
        texts, following = {"bench": bench, "procedure": procedure, "driver": driver}[kind](name)
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
        fault = not_there(f"there is no plan '{base}'", base, plans)
        raise InputError(f"--extends: {meant(*fault)}")
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
    package = package_of(registry.PROCEDURES, "procedure", name)
    values = {"name": name, "project": name, "package": package, "plan": f"{name}.yaml"}
    names = {
        "pyproject.toml": "pyproject.toml",
        "package/__init__.py": f"{package}/__init__.py",
        "package/steps.py": f"{package}/steps.py",
        "package/evaluate.py": f"{package}/evaluate.py",
        "plan.yaml": f"{name}.yaml",
        "test_package.py": f"test_{package}.py",
    }
    return package_files("procedure", name, names, values), [
        f"pip install -e {name}",
        f"station run {name}/{name}.yaml --non-interactive",
        f"pytest {name}",
        "put your method in place of the coil constant that it measures",
    ]


def driver(name: str) -> tuple[dict[Path, str], list[str]]:
    """Return a package with a driver, its simulator and their entry points, and a bench.

    The bench is the simulated one with the new driver's gaussmeter.
    """
    package = package_of(registry.DRIVERS, "driver", name)
    values = {
        "name": name,
        "project": name,
        "driver": f"{package}.driver",
        "simulator": f"{package}.simulator",
        "class_name": name.title().replace("-", ""),
        "model": name.upper(),
    }
    names = {
        "pyproject.toml": "pyproject.toml",
        "package/__init__.py": f"{package}/__init__.py",
        "package/driver.py": f"{package}/driver.py",
        "package/simulator.py": f"{package}/simulator.py",
    }
    entry = template("driver/entry.yaml", values)
    sim = files("config").joinpath(BENCHES, "sim.yaml").read_text(encoding="utf-8")
    bench_text = ENTRY.sub(lambda _: f"{entry}\n", sim[sim.index("\n") + 1 :], count=1)
    bench_text = bench_text.replace("\nname: sim\n", f'\nname: "{name}"\n', 1)
    bench_file = f"{name}/{name}.yaml"
    texts = package_files("driver", name, names, values) | {Path(bench_file): bench_text}
    return texts, [
        f"pip install -e {name}",
        f"station identify {bench_file}",
        "pytest -p station.conformance.plugin --pyargs station.conformance "
        f"--station-driver {name} --station-bench {bench_file}",
        "put your instrument's commands in place of those of the gaussmeter",
    ]


def package_of(group: str, word: str, name: str) -> str:
    """Return the Python package of a new procedure or driver; InputError where a name is taken."""
    package = name.replace("-", "_")
    if name in registry.names(group):
        raise InputError(f"there is a {word} '{name}' already; choose another name")
    if keyword.iskeyword(package) or keyword.iskeyword(package.title()):
        raise InputError(f"'{name}' is a keyword of Python; choose another name")
    if find_spec(package) is not None:
        raise InputError(f"Python has a module '{package}' already; choose another name")
    return package


def package_files(
    kind: str, name: str, names: Mapping[str, str], values: Mapping[str, str]
) -> dict[Path, str]:
    """Return the filled templates of a package in its folder."""
    return {
        Path(name, path): template(f"{kind}/{source}", values) for source, path in names.items()
    }


def free(kind: str, word: str, name: str) -> list[str]:
    """Return the names of all plans or benches; InputError where a name is among them."""
    names = dict(available(kind))
    if name in names:
        raise InputError(
            f"there is a {word} '{name}' already ({names[name]}), nothing was written; choose "
            "another name"
        )
    return list(names)
