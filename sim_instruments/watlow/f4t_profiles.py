"""The profiles of a Watlow F4T: how they are written, and how a profile runs.

From a public client of chamber makers (ChamberConnectLibrary): 18888 chooses which profile is
edited, 18890 adds (1375) or deletes (1772) it, 18606 is its name, 18920 its number of steps; from
19094 on each step has 170 registers: its type, hours, minutes and seconds, a jump's step and count,
rate and target of loop 1, guaranteed soak, eight events, what its end does. 16558 and 16560 choose
profile and step, 16562 starts (1782), 16566 pauses (146) and terminates (148), 16564 resumes (147);
16568 is the state, 16588 and 16590 profile and step, 16570 and 16622 the time that is left; 16886
and every 40th after it are the names. Assumed: a start switches the loop to automatic; what has no
steps, is out of its turn, or is a step that waits, ends in exception 3, as does a guaranteed soak,
which is not simulated; a rate is in K per minute; after its end (`user`) or termination the
set-point is that of the loop again, after `hold` it stays; a jump back is made so many times.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from sim_instruments.instrument import Setting
from sim_instruments.watlow.plant import SetPoint
from sim_instruments.wire.modbus import ILLEGAL_VALUE, ModbusError, Parameter, Words, chosen, shown

PROFILES, STEPS, EVENTS = 40, 50, 8
NAME_SIZE = 20
FIRST_STEP, PER_STEP, PER_NAME = 19094, 170, 40
NONE, OFF, ON, NO_CHANGE, YES, NO = 61, 62, 63, 1557, 106, 59
INSTANT, RAMP_TIME, RAMP_RATE, SOAK, JUMP, END = 1927, 1928, 81, 87, 116, 27
TYPES = (INSTANT, RAMP_TIME, RAMP_RATE, SOAK, JUMP, END)
HOLD, USER = 47, 100
ADD, EDIT, DELETE = 1375, 1770, 1772
START, PAUSE, RESUME, TERMINATE = 1782, 146, 147, 148
NOT_STARTED, COMPLETE, TERMINATED, RUNNING, PAUSED = 251, 252, 253, 149, 146
ROUNDING_S = 1e-6


@dataclass
class Step:
    """One step of a profile; `what` is its type."""

    what: int = NONE
    hours: int = 0
    minutes: int = 0
    seconds: int = 0
    jump_to: int = 1
    jumps: int = 1
    rate_K_per_min: float = 0.0
    target_degC: float = 0.0
    at_end: int = HOLD
    events: list[int] = field(default_factory=lambda: [NO_CHANGE] * EVENTS)

    def lasts_s(self, start_degC: float) -> float:
        """Return how long it takes from a set-point on."""
        if self.what == RAMP_RATE:
            way_K = abs(self.target_degC - start_degC)
            return 60.0 * way_K / self.rate_K_per_min if self.rate_K_per_min > 0 else math.inf
        if self.what in (JUMP, END):
            return 0.0
        return 3600.0 * self.hours + 60.0 * self.minutes + self.seconds


@dataclass
class Profile:
    """A profile as it is stored."""

    name: str = ""
    logs: int = NO
    steps: list[Step] = field(default_factory=lambda: [Step() for _ in range(STEPS)])

    def count(self) -> int:
        """Return how many steps it has: up to the first that has no type."""
        types = [step.what for step in self.steps]
        return types.index(NONE) if NONE in types else STEPS


class Loop(Protocol):
    """What a profile does with the controller it runs on."""

    def take_over(self) -> None:
        """Give the loop to a profile."""

    def give_back(self, *, hold: bool) -> None:
        """Go on without the profile, at its set-point or at the loop's own."""

    def switch_off(self) -> None:
        """Switch the loop off."""

    def set_event(self, number: int, state: int) -> None:
        """Set an event of the controller."""


class ProfileRun:
    """The profile that runs, step by step, at its own times."""

    def __init__(self, setting: Setting, set_point: SetPoint, loop: Loop) -> None:
        self._name, self._clock = f"{setting.name} profile", setting.clock
        self._lock, self._set_point, self._loop = setting.world.lock, set_point, loop
        self.state, self.number, self.step = NOT_STARTED, 1, 0
        self._profile, self._jumps_left = Profile(), dict[int, int]()
        self._end_s, self._left_s, self._turn = 0.0, 0.0, 0

    @property
    def active(self) -> bool:
        """Whether a profile has the loop."""
        return self.state in (RUNNING, PAUSED)

    def start(self, number: int, profile: Profile, step: int) -> None:
        """Run a profile from one of its steps on; ModbusError where it cannot be."""
        if self.active or not 1 <= step <= profile.count():
            raise ModbusError(ILLEGAL_VALUE)
        self.number, self._profile, self._jumps_left = number, profile, {}
        self.state = RUNNING
        self._loop.take_over()
        self._begin(step, self._clock.now())
        self._go_on()

    def pause(self) -> None:
        """Stand still; ModbusError where nothing runs."""
        if self.state != RUNNING:
            raise ModbusError(ILLEGAL_VALUE)
        self._left_s = self.step_left_s()
        self._set_point.jump(self._set_point.now_degC())
        self.state = PAUSED

    def resume(self) -> None:
        """Go on where it was paused; ModbusError where nothing is."""
        if self.state != PAUSED:
            raise ModbusError(ILLEGAL_VALUE)
        self.state, self._end_s = RUNNING, self._clock.now() + self._left_s
        self._move(self._profile.steps[self.step - 1], self._left_s)
        self._go_on()

    def terminate(self) -> None:
        """End it; nothing happens where nothing runs."""
        if self.active:
            self._end(TERMINATED, USER)

    def step_left_s(self) -> float:
        """Return what is left of the step."""
        if self.state == PAUSED:
            return self._left_s
        return max(self._end_s - self._clock.now(), 0.0) if self.state == RUNNING else 0.0

    def left_s(self) -> float:
        """Return what is left of the profile, jumps left aside."""
        if not self.active:
            return 0.0
        here_degC, left_s = self._set_point.target_degC, self.step_left_s()
        for step in self._profile.steps[self.step : self._profile.count()]:
            left_s += step.lasts_s(here_degC)
            here_degC = (
                step.target_degC if step.what in (INSTANT, RAMP_TIME, RAMP_RATE) else here_degC
            )
        return left_s

    def _go_on(self) -> None:
        """Have the next step begin when this one ends, unless something else happens before."""
        if self.state != RUNNING or math.isinf(self._end_s):
            return
        self._turn += 1
        turn = self._turn

        def next_step() -> float | None:
            with self._lock:
                if turn != self._turn or self.state != RUNNING:
                    return None
                self._begin(self.step + 1, self._end_s)
                running = self.state == RUNNING and not math.isinf(self._end_s)
                return self._end_s if running else None

        self._clock.repeat(f"{self._name} {turn}", self._end_s, next_step)

    def _begin(self, number: int, begin_s: float) -> None:
        """Begin a step, and those after it that take no time."""
        self.step, self._end_s = number, begin_s
        for _ in range(STEPS * STEPS):
            if self.step > self._profile.count():
                self._end(COMPLETE, HOLD)
                return
            step = self._profile.steps[self.step - 1]
            for n, state in enumerate(step.events, 1):
                if state != NO_CHANGE:
                    self._loop.set_event(n, state)
            if step.what == END:
                self._end(COMPLETE, step.at_end)
                return
            if step.what == JUMP:
                left = self._jumps_left.setdefault(self.step, step.jumps)
                self._jumps_left[self.step] = left - 1
                self.step = step.jump_to if left > 0 else self.step + 1
                continue
            lasts_s = step.lasts_s(self._set_point.now_degC())
            self._move(step, lasts_s)
            self._end_s = begin_s + lasts_s
            if lasts_s > ROUNDING_S:
                return
            self.step += 1
        self._end(COMPLETE, HOLD)  # jumps without an end that take no time

    def _move(self, step: Step, lasts_s: float) -> None:
        here_degC = self._set_point.now_degC()
        if step.what == INSTANT or (step.what == RAMP_TIME and lasts_s <= ROUNDING_S):
            self._set_point.jump(step.target_degC)
        elif step.what in (RAMP_TIME, RAMP_RATE):
            rate_K_per_s = abs(step.target_degC - here_degC) / lasts_s
            self._set_point.ramp(step.target_degC, rate_K_per_s, here_degC)

    def _end(self, state: int, at_end: int) -> None:
        self.state = state
        self._loop.give_back(hold=at_end == HOLD)
        if at_end == OFF:
            self._loop.switch_off()


class Profiles:
    """All stored profiles, and the registers that edit and run them.

    `in_range` tells of a target whether the limits of the set-point allow it.
    """

    def __init__(
        self,
        run: ProfileRun,
        floating: Callable[..., Parameter],
        in_range: Callable[[float], bool],
    ) -> None:
        self._run, self._float, self._in_range = run, floating, in_range
        self._stored = {number: Profile() for number in range(1, PROFILES + 1)}
        self._edited, self._to_start, self._first_step = 1, 1, 1

    def table(self) -> dict[int, Parameter]:
        """Return the registers."""
        run, numbers = self._run, range(1, PROFILES + 1)
        table = {
            16558: chosen(numbers, lambda: self._to_start, partial(setattr, self, "_to_start")),
            16560: chosen(
                range(1, STEPS + 1), lambda: self._first_step, partial(setattr, self, "_first_step")
            ),
            16562: chosen((START,), lambda: NONE, lambda _: self._start()),
            16564: chosen((RESUME,), lambda: NONE, lambda _: run.resume()),
            16566: chosen((PAUSE, TERMINATE), lambda: NONE, self._act),
            16568: shown(lambda: run.state),
            16570: shown(lambda: run.left_s() // 60 % 60),
            16572: shown(lambda: run.left_s() // 3600),
            16588: shown(lambda: run.number if run.active else 0),
            16590: shown(lambda: run.step if run.active else 0),
            16622: shown(lambda: run.step_left_s() % 60),
            16624: shown(lambda: run.step_left_s() // 60 % 60),
            16626: shown(lambda: run.step_left_s() // 3600),
            18606: Parameter(lambda: lettered(self._profile.name), self._rename, NAME_SIZE),
            18888: chosen(numbers, lambda: self._edited, partial(setattr, self, "_edited")),
            18890: chosen((ADD, EDIT, DELETE), lambda: NONE, self._edit),
            18920: shown(lambda: self._profile.count()),
            19038: chosen(
                (YES, NO), lambda: self._profile.logs, lambda word: self._set("logs", word)
            ),
        }
        for number in numbers:
            names = Parameter(partial(self._name_of, number), size=NAME_SIZE)
            table[16886 + PER_NAME * (number - 1)] = names
        for index in range(STEPS):
            first = FIRST_STEP + PER_STEP * index
            table |= {first + offset: each for offset, each in self._step(index).items()}
        return table

    def _step(self, index: int) -> dict[int, Parameter]:
        """Return the registers of a step, from its first one on."""

        def word(name: str, known: range | tuple[int, ...]) -> Parameter:
            return chosen(
                known,
                lambda: getattr(self._profile.steps[index], name),
                lambda value: self._set_step(index, name, value),
            )

        def number(name: str) -> Parameter:
            return self._float(
                lambda: getattr(self._profile.steps[index], name),
                lambda value: self._set_step(index, name, value),
            )

        def event(n: int) -> Parameter:
            def take(state: int) -> None:
                events = list(self._profile.steps[index].events)
                events[n] = state
                self._set_step(index, "events", events)

            return chosen((OFF, ON, NO_CHANGE), lambda: self._profile.steps[index].events[n], take)

        registers = {
            0: word("what", TYPES),
            2: word("hours", range(100)),
            4: word("minutes", range(60)),
            6: word("seconds", range(60)),
            8: word("jump_to", range(1, STEPS + 1)),
            10: word("jumps", range(1, 1000)),
            12: number("rate_K_per_min"),
            20: number("target_degC"),
            44: chosen((OFF,), lambda: OFF, lambda _: None),
            76: word("at_end", (HOLD, OFF, USER)),
        }
        # Four events, then the other four after what is not simulated.
        return registers | {(52 if n < 4 else 60) + 2 * n: event(n) for n in range(EVENTS)}

    @property
    def _profile(self) -> Profile:
        return self._stored[self._edited]

    def _name_of(self, number: int) -> Words:
        return lettered(self._stored[number].name)

    def _set(self, name: str, value: object) -> None:
        if self._run.active and self._run.number == self._edited:
            raise ModbusError(ILLEGAL_VALUE)
        setattr(self._profile, name, value)

    def _set_step(self, index: int, name: str, value: object) -> None:
        self._set("logs", self._profile.logs)  # refused where the profile runs
        if index > self._profile.count():
            raise ModbusError(ILLEGAL_VALUE)
        if name == "target_degC" and not self._in_range(float(value)):  # type: ignore[arg-type]
            raise ModbusError(ILLEGAL_VALUE)
        setattr(self._profile.steps[index], name, value)

    def _rename(self, words: Words) -> None:
        if any(word > 127 for word in words):
            raise ModbusError(ILLEGAL_VALUE)
        self._set("name", bytes(words).decode("ascii").rstrip("\0 "))

    def _edit(self, word: int) -> None:
        if word == EDIT:
            return
        self._set("steps", Profile().steps)
        self._set("name", "")

    def _start(self) -> None:
        self._run.start(self._to_start, self._stored[self._to_start], self._first_step)

    def _act(self, word: int) -> None:
        if word == PAUSE:
            self._run.pause()
        else:
            self._run.terminate()


def lettered(text: str) -> Words:
    """Return a name with one letter in each register."""
    return struct.unpack(f"{NAME_SIZE}B", text.ljust(NAME_SIZE, "\0").encode("ascii"))
