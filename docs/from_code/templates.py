"""The files of `station new procedure` and `new driver` as the how-tos show them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from station.cli.new import template

PROCEDURE = {
    "name": "coil-constant",
    "project": "fieldlab",
    "package": "fieldlab.coil_constant",
    "plan": "coil-x.yaml",
}
DRIVER = {
    "name": "mag-3",
    "project": "fieldlab",
    "driver": "fieldlab.mag3",
    "simulator": "fieldlab.mag3_simulator",
    "class_name": "Mag3",
    "model": "MAG-3",
}
SHOWN = {
    "procedure-declared": ("package/__init__.py", "file: fieldlab/coil_constant/__init__.py"),
    "procedure-steps": ("package/steps.py", "file: fieldlab/coil_constant/steps.py"),
    "procedure-evaluated": ("package/evaluate.py", "file: fieldlab/coil_constant/evaluate.py"),
    "procedure-project": ("pyproject.toml", "file: pyproject.toml"),
    "procedure-plan": ("plan.yaml", "file: coil-x.yaml"),
    "procedure-test": ("test_package.py", "file: test_coil_constant.py"),
    "driver-code": ("package/driver.py", "file: fieldlab/mag3.py"),
    "driver-simulator": ("package/simulator.py", "file: fieldlab/mag3_simulator.py"),
    "driver-project": ("pyproject.toml", "file: pyproject.toml"),
    "driver-package": ("package/__init__.py", "file: fieldlab/__init__.py"),
    "driver-entry": (
        "entry.yaml",
        "replace: gaussmeter in config/benches/sim.yaml as config/benches/lab.yaml",
    ),
}
LANGUAGES = {"py": "python", "toml": "toml", "yaml": "yaml"}


def shown(name: str) -> str:
    """Return a template as a marked block."""
    source, mark = SHOWN[name]
    kind = name.partition("-")[0]
    text = template(f"{kind}/{source}", PROCEDURE if kind == "procedure" else DRIVER)
    return f"<!-- {mark} -->\n```{LANGUAGES[source.rpartition('.')[2]]}\n{text}```"


MAKERS: dict[str, Callable[[], str]] = {name: partial(shown, name) for name in SHOWN}
