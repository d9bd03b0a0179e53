"""What a run has left of its evaluation: the revision that every report is drawn from."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from station.errors import DamagedRecord, reason_of
from station.parts import Part, parts_of_text
from station.record.folder import PLOTS, RESULTS, RunFolder
from station.record.later import revisions_of, revisions_of_all_data
from station.results import ResultDocument

OF_NOW = ("data-damaged", "no-manifest", "run-goes-on")
"""Flags that say in what state the folder was when the revision was made."""


@dataclass(frozen=True)
class Revision:
    """A revision of a run as it was left."""

    path: Path

    @cached_property
    def document(self) -> ResultDocument:
        """Its results; raises DamagedRecord where they cannot be read."""
        try:
            return ResultDocument.of(json.loads(self._text(RESULTS)))
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise DamagedRecord(f"{self.path / RESULTS} was altered: {reason_of(error)}") from error

    @property
    def drawn(self) -> bool:
        """Whether it holds plots; those of before they were data do not."""
        return (self.path / PLOTS).is_file()

    @cached_property
    def parts(self) -> Sequence[Part]:
        """Its plots and tables; raises DamagedRecord where they cannot be read."""
        try:
            return parts_of_text(self._text(PLOTS))
        except ValueError as error:
            raise DamagedRecord(f"{self.path / PLOTS} was altered: {reason_of(error)}") from error

    def _text(self, name: str) -> str:
        return (self.path / name).read_text(encoding="utf-8")


def newest_revision(folder: RunFolder) -> Revision | None:
    """Return the newest revision that stands for a run as its folder is now.

    None where a run went on since, or goes on; where data were damaged since; where the revision
    itself was altered, or the log names none.
    """
    there, damage = revisions_of(folder.path), folder.damage
    now = [flag.to_data() for flag in damage.flags()]
    for number in revisions_of_all_data(folder.events):
        path = there.get(number)
        if path is None or any(str(path) in sentence for sentence in damage.remade):
            continue
        revision = Revision(path)
        flags = [flag.to_data() for flag in revision.document.flags if flag.code in OF_NOW]
        if flags == now and not folder.goes_on:
            return revision
    return None
