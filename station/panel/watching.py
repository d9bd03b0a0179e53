"""One run as the panel shows it, read from its growing files; any number of viewers share it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from secrets import token_hex
from threading import Lock
from typing import Any

from station.clock import boot_seconds, utc_now
from station.control.live import LiveValues
from station.control.status import (
    RUN_STARTED,
    SENTENCES,
    in_words,
    last_message,
    remaining_s,
    since_it_went_on,
    state_of,
)
from station.errors import StationError
from station.files.locks import is_held
from station.guardian.notes import guardian_at_work
from station.panel.plots import Plots
from station.record.events import Event, guardian_events, latest_safe_state
from station.record.layout import EVENTS, LOCK
from station.record.log_tail import LogTail

LOOKS_EVERY_S = 0.1
"""Real time between two looks at the files, however many viewers there are."""
PLOTS_EVERY_S = 0.5
LATEST = 40
"""Lines of the log that are shown."""
WHOLE = json.dumps({"message": ""})
DAMAGE = (OSError, ValueError, LookupError, TypeError, AttributeError, StationError)
"""What a folder that was altered, or is another program's, may raise."""


class RunWatch:
    """What a run's files say, as numbered versions of JSON texts."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._log = LogTail(folder)
        self._plots = Plots(folder)
        self._events: list[Event] = []
        self._held = False
        self._lock = Lock()
        self._looked_s = self._plotted_s = float("-inf")
        self._live = LiveValues(folder)
        self._key = token_hex(4)
        self._texts = {"state": "", "live": "", "plots": "", "unreadable": WHOLE}
        self._versions = dict.fromkeys(self._texts, 0)

    def news(self, seen: dict[str, int]) -> Iterator[tuple[str, str]]:
        """Yield each kind of news that is new since `seen`, with its text."""
        with self._lock:
            now_s = boot_seconds()
            if now_s - self._looked_s >= LOOKS_EVERY_S:
                self._looked_s = now_s
                self._look(now_s)
            for name, version in self._versions.items():
                if version > seen.get(name, 0):
                    seen[name] = version
                    yield name, self._texts[name]

    def _look(self, now_s: float) -> None:
        """Read what was added; a folder that cannot be read is said to be so."""
        damage = ""
        for look in (self._read_log, self._look_at_state, lambda: self._look_at_plots(now_s)):
            try:
                look()
            except DAMAGE as error:
                damage = damage or f"{self.folder.name} cannot be read: {error}"
        self._put("unreadable", {"message": damage})

    def _read_log(self) -> None:
        self._held = is_held(self.folder / LOCK)  # first: a run that ends meanwhile has logged that
        for one in self._log.new_events():
            self._events.append(one)

    def _look_at_state(self) -> None:
        self._put("state", self.state())
        self._put("live", self.live())

    def _look_at_plots(self, now_s: float) -> None:
        if now_s - self._plotted_s >= PLOTS_EVERY_S and self._plots.look():
            self._plotted_s = now_s
            self._put("plots", self._plots.data())

    def mark(self, seen: dict[str, int]) -> str:
        """Return a word for what was seen, for a browser that comes again."""
        return ":".join([self._key, *(str(seen.get(name, 0)) for name in self._versions)])

    def seen_at(self, mark: str) -> dict[str, int]:
        """Return what was seen at a mark; nothing where another panel gave it."""
        key, *numbers = mark.split(":")
        if key != self._key or len(numbers) != len(self._versions):
            return {}
        return {name: int(n) for name, n in zip(self._versions, numbers, strict=True)}

    def _put(self, name: str, data: dict[str, Any]) -> None:
        text = json.dumps(data, allow_nan=False)
        if text != self._texts[name]:
            self._texts[name] = text
            self._versions[name] += 1

    def live(self) -> dict[str, Any]:
        """Return what the run sets and reads just now; nothing where it does not answer."""
        return (self._live.newest() if self._held else None) or {
            "instruments": [],
            "interlocks": [],
        }

    def state(self) -> dict[str, Any]:
        """Return how the run stands now."""
        events, held = self._events, self._held
        planned = next((one.details for one in events if one.kind == RUN_STARTED), {})
        state = state_of(events, held)
        of_guardian = guardian_events(self.folder)
        safe = latest_safe_state(events, of_guardian)
        steps = steps_of(planned, since_it_went_on(events))
        done = {one.details["unit"] for one in events if one.kind == "unit-finished"}
        speed = float(planned.get("speed") or 0.0)
        now_s = events[-1].time_s if events else 0.0
        if events and speed and state in ("running", "paused"):  # time goes on between two events
            now_s += self._age_s() * speed
        goes_on = events and planned and state in ("running", "paused", "evaluating")
        left_s = remaining_s(planned, events, now_s) if goes_on else None
        real_s = left_s / speed if left_s is not None and speed else None
        return {
            "run": self.folder.name,
            "procedure": planned.get("procedure"),
            "dut": planned.get("dut"),
            "bench": planned.get("bench"),
            "state": state,
            "sentence": SENTENCES[state],
            "message": last_message(events, of_guardian, guardian_at_work(self.folder)),
            "steps": steps,
            "units_done": len(done),
            "units_planned": len(planned.get("units") or ()) or None,
            "time_s": round(now_s),
            "left_s": None if left_s is None else round(left_s),
            "ends": None if real_s is None else self._end(real_s),
            "prompt": open_prompt(events) if held else None,
            "safe": None if safe is None else [dict(one) for one in safe],
            "log": [{"t": one.time_s, "text": in_words(one)} for one in events[-LATEST:]],
        }

    def _age_s(self) -> float:
        """Return how long ago the last event was logged, in real time."""
        logged_s = (self.folder / EVENTS).stat().st_mtime
        return max(utc_now().timestamp() - logged_s, 0.0)

    def _end(self, real_s: float) -> int:
        """Return the time of the end in whole minutes of UTC: it stays the same for a while."""
        return round((utc_now().timestamp() + real_s) / 60.0)


def steps_of(planned: dict[str, Any], events: list[Event] | Any) -> list[dict[str, str]]:
    """Return number, title and state of each step: `waits`, `now` or `done`."""
    begun = [one.details["step"] for one in events if one.kind == "step-started"]
    finished = {one.details["step"] for one in events if one.kind == "step-finished"}
    return [
        {
            "number": one["step"],
            "title": one.get("title", ""),
            "state": "done"
            if one["step"] in finished
            else "now"
            if begun and begun[-1] == one["step"]
            else "waits",
        }
        for one in planned.get("steps", ())
    ]


def open_prompt(events: list[Event]) -> dict[str, Any] | None:
    """Return the prompt that waits for an answer, as the log has it, and its `number`."""
    waiting: dict[str, dict[str, Any]] = {}
    for number, one in enumerate(since_it_went_on(events)):
        if one.kind == "prompt-shown":
            waiting[one.details["id"]] = {**one.details, "number": number}
        elif one.kind == "prompt":
            waiting.pop(one.details["id"], None)
        elif one.kind in ("failed", "run-ended"):
            waiting.clear()
    return next(iter(waiting.values()), None)
