"""The marks that stand beside words, for terminals of either kind."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Marks:
    """One character for each; a word always says the same."""

    good: str
    bad: str
    now: str
    waits: str
    more: str
    levels: str
    """From the least value of a sparkline to the greatest."""

    @classmethod
    def of(cls, encoding: str) -> Marks:
        """Return those that a terminal of an encoding can show."""
        return FULL if encoding.lower().replace("-", "").startswith("utf") else PLAIN

    def step(self, state: str) -> str:
        """Return the mark of a step: `done`, `now` or `waits`."""
        return {"done": self.good, "now": self.now}.get(state, self.waits)

    def lock(self, state: str) -> str:
        """Return the mark of an interlock: `clear`, `waits` or `tripped`."""
        return {"clear": self.good, "tripped": self.bad}.get(state, "!")

    def state(self, state: str) -> str:
        """Return the mark of a run's state."""
        marks = {"finished": self.good, "failed": self.bad, "interrupted": self.bad, "paused": "!"}
        return marks.get(state, self.now)


FULL = Marks(good="✔", bad="✘", now="▶", waits="·", more="…", levels="▁▂▃▄▅▆▇█")
PLAIN = Marks(good="+", bad="X", now=">", waits=".", more="...", levels="_.-=*#")
