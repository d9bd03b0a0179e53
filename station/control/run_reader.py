"""A run as whoever watches it sees it, read from its growing log: the panel and every terminal."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from threading import Lock, Thread
from typing import Any, NamedTuple

from station.clock import RealClock, boot_seconds, utc_now
from station.control.channel import ask
from station.control.status import message_of, run_time_s
from station.errors import DamagedRecord, StationError
from station.files.locks import is_held
from station.guardian.notes import guardian_at_work
from station.record.events import (
    Event,
    LogTail,
    guardian_events,
    in_words,
    is_of_line,
    rest_in_words,
)
from station.record.layout import LOCK
from station.record.run_state import GOES_ON, SENTENCES, RunState, State
from station.record.verification import quick_look

LATEST = 40
"""Lines of the log that are shown."""
DAMAGE = (OSError, ValueError, LookupError, TypeError, AttributeError, StationError)
"""What a folder that was altered, or is another program's, may raise."""
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
        self._state = RunState()
        self._latest: deque[Event] = deque(maxlen=LATEST)
        self._held = False
        self._damage: Exception | None = None
        self._live = LiveValues(folder)

    def read(self) -> None:
        """Read what was added to the log; may raise what `DAMAGE` names."""
        self._held = is_held(self.folder / LOCK)  # first: a run that ends meanwhile has logged that
        if self._damage is not None:
            raise self._damage
        for event in self._log.new_events():
            try:
                self._state.add(event)
            except DAMAGE as error:  # no later event mends it
                self._damage = error
                raise
            if not is_of_line(event):
                self._latest.append(event)

    def refuse_altered(self) -> None:
        """Raise DamagedRecord where a run that has ended is not any more as it was left."""
        record = quick_look(self.folder)
        if record.state == "altered":
            raise DamagedRecord(record.sentence())

    def live(self) -> dict[str, Any]:
        """Return what the run sets and reads just now; nothing where it does not answer."""
        return (self._live.newest() if self._held else None) or NOTHING_LIVE

    def state(self) -> dict[str, Any]:
        """Return how the run stands as it was read last; may raise what `DAMAGE` names.

        Times are whole seconds, the end whole minutes of UTC: they stay the same for a while.
        `began_s` is what the bench's clock was at when the run began, as the raw data have it.
        """
        run, planned = self._state, self._state.planned
        run.guardian_logged(guardian_events(self.folder))
        state, safe = run.state(held=self._held), run.safe_state()
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
            "message": message_of(run, guardian_at_work(self.folder)),
            "steps": run.steps(),
            "units_done": len(run.units),
            "units_planned": len(planned.get("units") or ()) or None,
            "began_s": run.began_s,
            "time_s": round(now_s - run.began_s),
            "left_s": None if left_s is None else round(left_s),
            "ends": None if ends is None else round(ends.timestamp() / 60.0),
            "prompt": run.open_prompt if self._held else None,
            "safe": None if safe is None else [dict(outcome) for outcome in safe],
            "left_out": run.left_out(),
            "rest": self._rest(safe),
            "log": [
                {"t": event.time_s - run.began_s, "text": in_words(event)} for event in self._latest
            ],
        }

    def _rest(self, safe: Sequence[Mapping[str, Any]] | None) -> dict[str, Any] | None:
        """Return how the run left its bench, None where nobody has read it back."""
        if safe is None:
            return None
        left_out = self._state.left_out()
        verified, sentence = rest_in_words(safe, left_out)
        return {"known": verified and not left_out, "sentence": sentence}

    def times(self, state: State, live: Mapping[str, Any] = NOTHING_LIVE) -> Times:
        """Return how long the run has taken and will take, as of now.

        `live` is what the run answered; one that does not answer is believed to go on.
        """
        now_s = self._now_s(state, live)
        left_s = self._left_s(state, now_s)
        return Times(now_s - self._state.began_s, left_s, self._ends(left_s))

    def _now_s(self, state: State, live: Mapping[str, Any]) -> float:
        """Return the run time in s: as the run answered, or that of its last event and since."""
        if "time_s" in live:
            return max(self._state.last_s, float(live["time_s"]))
        return run_time_s(self.folder, self._state, state)

    def _left_s(self, state: State, now_s: float) -> float | None:
        return self._state.remaining_s(now_s) if state in GOES_ON else None

    def _ends(self, left_s: float | None) -> datetime | None:
        """Return when a run that takes so much bench time still ends; None on virtual time."""
        speed = self._state.speed
        if left_s is None or not speed:
            return None
        try:
            return utc_now() + timedelta(seconds=left_s / speed)
        except OverflowError:  # beyond all calendars
            return None


def sentence_of_now(state: Mapping[str, Any], live: Mapping[str, Any]) -> str:
    """Return what goes on just now: what is waited for, what the step does, or the last message."""
    if state["prompt"]:
        return f"waits for an answer: {state['prompt']['text']}"
    doing = live.get("now") if state["state"] == "running" else ""
    pause = "; a pause comes after this unit of work" if live.get("pause_requested") else ""
    return f"{doing or state['message']}{pause}"


EVERY_S, AGAIN_S = 0.25, 1.0
"""Real time between two questions, and after one that was not answered."""
OLD_AFTER_S = 3.0
"""Real time after which an answer is not shown any more."""
UNUSED_S = 5.0
"""Real time without a viewer after which the run is not asked any more."""


class LiveValues:
    """The newest answer of a run to `live`; a thread asks while somebody looks."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._newest: tuple[float, dict[str, Any]] | None = None
        self._looked_s = 0.0
        self._asks = False
        self._lock = Lock()

    def newest(self) -> dict[str, Any] | None:
        """Return `instruments` and `interlocks`; None where the run has not answered lately."""
        self._looked_s = boot_seconds()
        with self._lock:
            if not self._asks:
                self._asks = True
                Thread(target=self._ask, name="live values", daemon=True).start()
        newest = self._newest
        if newest is None or boot_seconds() - newest[0] > OLD_AFTER_S:
            return None
        return newest[1]

    def _ask(self) -> None:
        while boot_seconds() - self._looked_s < UNUSED_S:
            try:
                word = ask(self._folder, "live")
                wait_s = EVERY_S
            except (StationError, OSError):  # it ended, or hangs: what is shown grows old
                word, wait_s = {}, AGAIN_S
            if "instruments" in word:
                self._newest = boot_seconds(), word
            RealClock().sleep(wait_s)
        with self._lock:
            self._asks = False
