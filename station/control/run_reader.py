"""A run as whoever watches it sees it, read from its growing log: the panel and every terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from station.clock import utc_now
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
from station.record.events import Event, guardian_events, latest_left_out, latest_safe_state
from station.record.layout import EVENTS, LOCK
from station.record.log_tail import LogTail

LATEST = 40
"""Lines of the log that are shown."""
DAMAGE = (OSError, ValueError, LookupError, TypeError, AttributeError, StationError)
"""What a folder that was altered, or is another program's, may raise."""
GOES_ON = ("running", "paused", "evaluating")
NOTHING_LIVE: dict[str, Any] = {"instruments": [], "interlocks": [], "now": ""}


class Times(NamedTuple):
    """How long a run takes, in s of bench time, and when it ends, None where nobody knows."""

    elapsed_s: float
    left_s: float | None
    ends: datetime | None


class RunReader:
    """What the files of a run say, and what its process answers; it changes nothing."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._log = LogTail(folder)
        self._events: list[Event] = []
        self._held = False
        self._planned: dict[str, Any] = {}
        self._live = LiveValues(folder)

    def read(self) -> None:
        """Read what was added to the log; may raise what `DAMAGE` names."""
        self._held = is_held(self.folder / LOCK)  # first: a run that ends meanwhile has logged that
        for event in self._log.new_events():
            self._events.append(event)

    def live(self) -> dict[str, Any]:
        """Return what the run sets and reads just now; nothing where it does not answer."""
        return (self._live.newest() if self._held else None) or NOTHING_LIVE

    def state(self) -> dict[str, Any]:
        """Return how the run stands as it was read last; may raise what `DAMAGE` names.

        Times are whole seconds, the end whole minutes of UTC: they stay the same for a while.
        `began_s` is what the bench's clock was at when the run began, as the raw data have it.
        """
        held = self._held
        events = self._events
        if not self._planned:
            self._planned = next(
                (event.details for event in events if event.kind == RUN_STARTED), {}
            )
        planned = self._planned
        state = state_of(events, held)
        of_guardian = guardian_events(self.folder)
        safe = latest_safe_state(events, of_guardian)
        done = {event.details["unit"] for event in events if event.kind == "unit-finished"}
        began_s = self._began_s
        now_s = self._now_s(state, NOTHING_LIVE)
        left_s = self._left_s(state, now_s)
        ends = self._ends(left_s)
        return {
            "run": self.folder.name,
            "procedure": planned.get("procedure"),
            "dut": planned.get("dut"),
            "bench": planned.get("bench"),
            "state": state,
            "sentence": SENTENCES[state],
            "message": last_message(events, of_guardian, guardian_at_work(self.folder)),
            "steps": steps_of(planned, since_it_went_on(events)),
            "units_done": len(done),
            "units_planned": len(planned.get("units") or ()) or None,
            "began_s": began_s,
            "time_s": round(now_s - began_s),
            "left_s": None if left_s is None else round(left_s),
            "ends": None if ends is None else round(ends.timestamp() / 60.0),
            "prompt": open_prompt(events) if held else None,
            "safe": None if safe is None else [dict(outcome) for outcome in safe],
            "left_out": latest_left_out(events, of_guardian),
            "log": [
                {"t": event.time_s - began_s, "text": in_words(event)} for event in events[-LATEST:]
            ],
        }

    def times(self, state: str, live: Mapping[str, Any] = NOTHING_LIVE) -> Times:
        """Return how long the run has taken and will take, as of now.

        `live` is what the run answered; one that does not answer is believed to go on.
        """
        now_s = self._now_s(state, live)
        left_s = self._left_s(state, now_s)
        return Times(now_s - self._began_s, left_s, self._ends(left_s))

    @property
    def _began_s(self) -> float:
        """What the bench's clock was at when the run began: a served one goes on between runs."""
        return self._events[0].time_s if self._events else 0.0

    def _now_s(self, state: str, live: Mapping[str, Any]) -> float:
        """Return the run time in s: as the run answered, or that of its last event and since."""
        now_s = self._events[-1].time_s if self._events else 0.0
        if "time_s" in live:
            return max(now_s, float(live["time_s"]))
        speed = float(self._planned.get("speed") or 0.0)
        if not speed or not self._events or state not in ("running", "paused"):
            return now_s
        age_s = utc_now().timestamp() - (self.folder / EVENTS).stat().st_mtime
        return now_s + max(age_s, 0.0) * speed

    def _left_s(self, state: str, now_s: float) -> float | None:
        known = self._planned and self._events and state in GOES_ON
        return remaining_s(self._planned, self._events, now_s) if known else None

    def _ends(self, left_s: float | None) -> datetime | None:
        """Return when a run that takes so much bench time still ends; None on virtual time."""
        speed = float(self._planned.get("speed") or 0.0)
        if left_s is None or not speed:
            return None
        try:
            return utc_now() + timedelta(seconds=left_s / speed)
        except OverflowError:  # beyond all calendars
            return None


def steps_of(planned: dict[str, Any], events: Sequence[Event]) -> list[dict[str, str]]:
    """Return number, title and state of each step: `waits`, `now` or `done`."""
    begun = [event.details["step"] for event in events if event.kind == "step-started"]
    finished = {event.details["step"] for event in events if event.kind == "step-finished"}
    return [
        {
            "number": step["step"],
            "title": step.get("title", ""),
            "state": "done"
            if step["step"] in finished
            else "now"
            if begun and begun[-1] == step["step"]
            else "waits",
        }
        for step in planned.get("steps", ())
    ]


def open_prompt(events: Sequence[Event]) -> dict[str, Any] | None:
    """Return the prompt that waits for an answer, as the log has it, and its `number`."""
    waiting: dict[str, dict[str, Any]] = {}
    for number, event in enumerate(since_it_went_on(events)):
        if event.kind == "prompt-shown":
            waiting[event.details["id"]] = {**event.details, "number": number}
        elif event.kind == "prompt":
            waiting.pop(event.details["id"], None)
        elif event.kind in ("failed", "run-ended"):
            waiting.clear()
    return next(iter(waiting.values()), None)


def sentence_of_now(state: Mapping[str, Any], live: Mapping[str, Any]) -> str:
    """Return what goes on just now: what is waited for, what the step does, or the last message."""
    if state["prompt"]:
        return f"waits for an answer: {state['prompt']['text']}"
    doing = live.get("now") if state["state"] == "running" else ""
    pause = "; a pause comes after this unit of work" if live.get("pause_requested") else ""
    return f"{doing or state['message']}{pause}"
