"""Look once more at everything that can harm, right before anybody says that the bench is safe.

What was read back as off when it was switched off may have come on again since, or may have lied.
So this waits for a while after the last command, asks the witnesses, reads what was not commanded,
then what was, and brings to rest once more what is on again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from station.clock import Clock, RealClock, utc_now
from station.console import no_older
from station.errors import reason_of
from station.instruments.beside import Beside
from station.instruments.whole_bench import WITHIN_S, BenchReading
from station.roles.base import MadeSafe
from station.safety.safe_state import Hurried, Hurry, SafeOutcome, make_bench_safe, unhurried
from station.safety.witness import NOT_ASKED, WitnessReport, contradicted

SETTLES_S = 4.0
"""Run time from the last command that switches something off to the look that is believed; what
comes on again later than that is seen by nobody before the next run."""
TIMES_AGAIN = 2
"""What is on again is brought to rest so many times more."""
FRESH_S = 2.0
"""Run time; what was read longer ago than this is read once more, where it answers at all."""


@dataclass(frozen=True)
class LastLook:
    """How everything on the bench that can harm stands, and what the witnesses say of it.

    `again`: what was on again, each time in words. `oldest_s` is the age of the oldest reading at
    `utc`, when the look ended, in s of real time, or of virtual time.
    """

    bench: BenchReading
    witness_reports: Sequence[WitnessReport]
    again: Sequence[str]
    oldest_s: float
    utc: str

    def to_data(self) -> dict[str, Any]:
        """Return the look as plain data."""
        return {
            **self.bench.to_data(),
            "witnesses": [report.to_data() for report in self.witness_reports],
            "oldest_s": round(self.oldest_s, 3),
        }

    @property
    def when(self) -> str:
        """When everything was read, for a person: time of the look, age of its oldest reading."""
        return f" (at {self.utc[11:19]} UTC, {no_older(self.oldest_s)})"

    @property
    def used(self) -> list[SafeOutcome]:
        """How the instruments of the run came to rest."""
        return list(self.bench.used)


def look_last(
    instruments: Mapping[str, object],
    outcomes: Sequence[SafeOutcome],
    order: Sequence[tuple[str, float]],
    clock: Clock,
    hurry: Hurry,
    read_others: Callable[[Sequence[str] | None], BenchReading],
    testify: Callable[[], Sequence[WitnessReport]],
) -> LastLook:
    """Look at `instruments` that were brought to rest with these `outcomes`, and at all others.

    `read_others` reads what was not commanded: all of it, or those that are named. `testify` asks
    the witnesses. What is not verified already is left to whoever goes on trying.
    """
    known = {outcome.instrument: outcome for outcome in outcomes}
    again: list[str] = []
    for times_left in range(TIMES_AGAIN, -1, -1):
        verified = [name for name, outcome in known.items() if outcome.verified]
        if verified:
            settle(clock, hurry)
        witness_reports = testify() if verified else ()
        others = read_others(None)
        known |= read_now({name: instruments[name] for name in verified}, known, clock)
        if others.energised:  # which the witnesses see as well
            on = ", ".join(reading.instrument for reading in others.energised)
            witness_reports = [unasked(report, f"{on} is on") for report in witness_reports]
        against = contradicted(witness_reports)
        wrong = {
            name: against[name] if known[name].verified else known[name].read_back
            for name in verified
            if not known[name].verified or name in against
        }
        if not wrong:
            break
        again += [f"{name}: {words.removeprefix(f'{name}: ')}" for name, words in wrong.items()]
        if times_left:
            once_more = {name: instruments[name] for name in wrong}
            made_safe = make_bench_safe(once_more, order, clock, hurry)
            known |= {outcome.instrument: outcome for outcome in made_safe}
            continue
        for name in wrong:
            known[name] = named(known[name], against.get(name, ""))
    others = read_again_where_old(others, read_others, clock)
    looked_s = clock.now()
    speed = clock.speed if isinstance(clock, RealClock) else 1.0
    read_s = [outcome.read_s for outcome in (*known.values(), *others.outside) if outcome.verified]
    return LastLook(
        replace(others, used=list(known.values())),
        list(witness_reports),
        again,
        (looked_s - min(read_s, default=looked_s)) / speed,
        utc_now().isoformat(timespec="seconds"),
    )


def unasked(report: WitnessReport, why: str) -> WitnessReport:
    """Return the report of a witness that cannot say anything, with the reason."""
    return replace(report, agrees=None, ambient=False, sentence=f"{NOT_ASKED}{why}")


def settle(clock: Clock, hurry: Hurry) -> None:
    """Wait for what may come on again after the last command, unless somebody is in a hurry."""
    until_s = clock.now() + SETTLES_S
    while clock.now() < until_s and not hurry.asked:
        try:
            clock.sleep(min(0.1, max(until_s - clock.now(), 0.0)))
        except Hurried:
            return


def read_now(
    instruments: Mapping[str, object], known: Mapping[str, SafeOutcome], clock: Clock
) -> dict[str, SafeOutcome]:
    """Read how instruments stand: at once on real clocks, in turn on virtual time."""

    def read(name: str) -> SafeOutcome:
        instrument = instruments[name]
        assert isinstance(instrument, MadeSafe)
        asked_s = clock.now()
        try:
            reading = unhurried(instrument.read_safety)
        except Exception as error:  # whatever it is, the others are still read
            why = reason_of(error)
            return replace(known[name], verified=False, read_back=why, read_s=math.nan)
        return replace(
            known[name], verified=reading.safe, read_back=reading.read_back, read_s=asked_s
        )

    if not isinstance(clock, RealClock):
        return {name: read(name) for name in instruments}
    readings = Beside(read).do([[name] for name in instruments], WITHIN_S)
    silent = f"it did not answer within {WITHIN_S:g} s"
    return {
        name: readings.get(name)
        or replace(known[name], verified=False, read_back=silent, read_s=math.nan)
        for name in instruments
    }


def named(outcome: SafeOutcome, against: str) -> SafeOutcome:
    """Return what is to be read of an instrument that could not be kept at rest."""
    if outcome.verified:
        words = f"it reads back {outcome.read_back}, but {against}"
        return replace(outcome, verified=False, doubted=True, read_back=words)
    if math.isnan(outcome.read_s):  # it does not answer any more
        return outcome
    return replace(outcome, read_back=f"on again after it was switched off: {outcome.read_back}")


def read_again_where_old(
    others: BenchReading, read_others: Callable[[Sequence[str] | None], BenchReading], clock: Clock
) -> BenchReading:
    """Return what was not commanded, read once more where its reading is old."""
    oldest_s = clock.now() - clock.patience_s(FRESH_S)
    old = [reading.instrument for reading in others.outside if reading.read_s < oldest_s]
    if not old:
        return others
    fresh = read_others(old)
    newer = {reading.instrument: reading for reading in fresh.outside}
    return replace(
        others,
        outside=[newer.get(reading.instrument, reading) for reading in others.outside],
        left_out=[*others.left_out, *fresh.left_out],
    )
