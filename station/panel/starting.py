"""A run that somebody wants to start from the panel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from station.errors import InputError
from station.files.lookup import BENCHES, PLANS, available
from station.files.plan.composition import identifying
from station.panel.access import Role

MAX_WORD = 200


@dataclass(frozen=True)
class Wanted:
    """What somebody wants to run: names of plan and bench, serial number, who operates."""

    plan: str
    bench: str
    serial: str
    operator: str

    @classmethod
    def of(cls, data: dict[str, Any]) -> Wanted:
        """Return what a request names; raises InputError."""
        words = {name: data.get(name, "") for name in ("plan", "bench", "serial", "operator")}
        for name, word in words.items():
            if not isinstance(word, str) or len(word) > MAX_WORD or not word.isprintable():
                raise InputError(f"{name}: write one line of {MAX_WORD} characters at most")
        for kind, name in ((PLANS, words["plan"]), (BENCHES, words["bench"])):
            if name not in dict(available(kind)):
                raise InputError(f"there is no {kind.removesuffix('s')} of the name '{name}'")
        if not words["serial"].strip():
            raise InputError("scan or type the serial number of the device first")
        return cls(**{name: word.strip() for name, word in words.items()})

    @property
    def overrides(self) -> list[str]:
        """What is set in the plan."""
        return identifying(self.serial, self.operator or None)


class Starting(Protocol):
    """Whoever looks at a run before it begins, and begins it."""

    def look(self, wanted: Wanted, role: Role) -> dict[str, Any]:
        """Return what it would do, or in `faults` what keeps it from being started."""
        ...

    def start(self, wanted: Wanted, role: Role) -> str:
        """Begin it and return the name of its folder; raises InputError with what is wrong."""
        ...

    def resume(self, folder: Path, role: Role) -> None:
        """Go on with a run; raises InputError with what is wrong."""
        ...

    def certificate(self, folder: Path, language: str) -> Path:
        """Make the certificate of a run as PDF and return it; raises InputError."""
        ...
