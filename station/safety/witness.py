"""Ask a second instrument whether what was switched off is off: the gaussmeter in a coil.

A supply that answers falsely is believed by its driver. What it drives is seen by others: a witness
is read before anything is energised, watched while a source is driven, and asked once more when all
is to be off. It speaks of a source only where it saw that source's change and nothing was moved
since. A run and its guardian judge alike, by the same plain data.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from station.errors import BenchEnergised, InstrumentError
from station.roles.role import Witness, role, role_of
from station.safety.safe_state import Hurried, unhurried

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.clock import Clock

LARGEST_LEFT = 0.1
"""Of the largest change that was seen; more contradicts a source that reads back as off."""
AMBIENT_LEFT = 0.03
"""A change between this and `LARGEST_LEFT` is flagged: the ambient field is another one."""
MIN_SEEN = 0.2
"""Of what the bench's constants expect; less is not the change of that source."""
OVERLOAD = 1e30
"""What instruments say of an overload is beyond it."""
GROWN = 1.2
"""By which the largest change grows before the guardians are informed again."""
LOOKS, LOOKS_BEFORE, LOOKS_EVERY_S = 5, 3, 0.37
"""Run time; no sine that a coil supply makes is near its zero at all of them."""
TURNED = 4.0
"""Of the magnitude before; turning a probe in an ambient field makes 2 at most."""
NOT_ASKED = "not asked: "
NOT_DRIVEN = "nothing was driven that it could see"
NOT_ALIKE = "it does not see now what it saw before: turned, or beyond its range"
NOT_REACHED, STAND_STILL = "it cannot be reached", "its readings stand still"
NOT_SEEN = "it saw no change of what was driven"


@dataclass
class Sighting:
    """What a witness saw, in `unit`: `before` anything was energised, by component, NaN what it
    does not see, and how far the readings then lay apart (`spread`); the largest change that was
    `expected` of each source that was driven, and that was seen of it; and why it cannot speak of
    the others.
    """

    instrument: str
    unit: str
    before: list[float]
    spread: float = 0.0
    expected: dict[str, float] = field(default_factory=dict)
    change: dict[str, float] = field(default_factory=dict)
    lost: dict[str, str] = field(default_factory=dict)
    energised: str = ""
    """What shows that something was on before the run energised anything."""

    def to_data(self) -> dict[str, Any]:
        """Return it as plain data for a guardian."""
        return asdict(self)


@dataclass(frozen=True)
class WitnessReport:
    """What a witness says of its `sources` at the end; `agrees` is None where it was not asked."""

    instrument: str
    sources: Sequence[str]
    agrees: bool | None
    sentence: str
    ambient: bool = False
    """Whether more is left than nothing, and less than contradicts: the ambient field changed."""

    def to_data(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


def not_asked(report: WitnessReport) -> str:
    """Return for a person that a witness was not asked, and why; empty where it was."""
    if report.agrees is not None:
        return ""
    why = report.sentence.removeprefix(NOT_ASKED)
    return f"the {report.instrument} was not asked whether what it sees is off: {why}"


def witness_of(instance: str) -> Witness | None:
    """Return what the role of an instrument declares of it as a witness."""
    declared = role(role_of(instance))
    return declared.witness if declared else None


def judge(sighting: Sighting, instrument: object | None, clock: Clock) -> WitnessReport:
    """Ask an opened witness, None where it cannot be reached, and hold it against what it saw.

    What is left may swing through zero as a sine does: it is asked several times. The second
    largest counts, for one reading may be wild.
    """
    name, unit = sighting.instrument, sighting.unit
    sources = sorted(sighting.change or sighting.expected)
    if not sources:
        return WitnessReport(name, (), None, f"{NOT_ASKED}{NOT_DRIVEN}")
    if sighting.energised:
        return WitnessReport(name, sources, False, sighting.energised)
    if instrument is None:
        return WitnessReport(name, sources, None, f"{NOT_ASKED}{NOT_REACHED}")
    try:
        looks = several_looks(name, instrument, clock, LOOKS)
    except InstrumentError as error:
        return WitnessReport(name, sources, None, f"{NOT_ASKED}{error}")
    if sighting.change:  # nothing was turned since
        looks = [as_turned(look, sighting.before) for look in looks]
    left = [distance(look, sighting.before) for look in looks]
    if any(map(math.isnan, left)):
        return WitnessReport(name, sources, None, f"{NOT_ASKED}{NOT_ALIKE}")
    most = sorted(left)[-2]
    if sighting.spread and 0.0 < most < math.inf and stand_still(looks):
        return WitnessReport(name, sources, None, f"{NOT_ASKED}{STAND_STILL}")
    if not sighting.change:
        return _of_unseen(sighting, sources, most)
    largest = max(sighting.change.values())
    words = f"{amount(most, unit)} are left of a change of {largest:.3g} {unit}"
    agrees = most <= LARGEST_LEFT * largest
    ambient = agrees and most > AMBIENT_LEFT * largest
    if lost := {source: why for source, why in sighting.lost.items() if source not in sources}:
        words += f"; not asked of {', '.join(lost)}: {'; '.join(dict.fromkeys(lost.values()))}"
    return WitnessReport(name, sources, agrees, words, ambient)


def amount(value: float, unit: str) -> str:
    """Return what is left in words: beyond the range of an instrument there is no number."""
    return f"more than its range in {unit}" if math.isinf(value) else f"{value:.3g} {unit}"


def several_looks(name: str, instrument: object, clock: Clock, looks: int) -> list[list[float]]:
    """Return the components that a witness sees, several times in turn; raises InstrumentError."""
    seen = [unhurried(lambda: read_now(name, instrument))]
    for _ in range(looks - 1):
        with suppress(Hurried):  # comes once, and shortens this pause alone
            clock.sleep(LOOKS_EVERY_S)
        seen.append(unhurried(lambda: read_now(name, instrument)))
    return seen


def as_turned(now: Sequence[float], before: Sequence[float]) -> list[float]:
    """Return components by the axis that a probe of one axis has.

    A driver that has just been opened does not know how its probe is turned.
    """
    seen = [value for value in now if not math.isnan(value)]
    known = [number for number, value in enumerate(before) if not math.isnan(value)]
    if len(seen) != 1 or len(known) != 1:
        return list(now)
    return [seen[0] if number in known else math.nan for number in range(len(before))]


def stand_still(looks: Sequence[Sequence[float]]) -> bool:
    """Whether all looks gave the same to the last digit."""
    return len({tuple(map(repr, look)) for look in looks}) == 1


def _of_unseen(sighting: Sighting, sources: Sequence[str], most: float) -> WitnessReport:
    """Return what a witness says of sources whose change it did not see, or not since a move.

    What is far more than any turn of it could make of what was there before is theirs.
    """
    name, unit = sighting.instrument, sighting.unit
    if most > beyond_turning(max(sighting.expected.values()), sighting.before):
        return WitnessReport(
            name, sources, False, f"it is {amount(most, unit)} off what it was before"
        )
    reasons = "; ".join(dict.fromkeys(sighting.lost.values()))
    return WitnessReport(name, (), None, f"{NOT_ASKED}{reasons or NOT_SEEN}")


def beyond_turning(expected: float, before: Sequence[float]) -> float:
    """Return the change that no turn of a witness makes of what was there before."""
    return max(MIN_SEEN * expected, TURNED * distance(before, [0.0] * len(before)))


def read_now(name: str, instrument: object) -> list[float]:
    """Return the components that a witness sees now; raises InstrumentError."""
    witness = witness_of(name)
    assert witness is not None
    return [float(value) for value in witness.read(instrument)]


def distance(now: Sequence[float], before: Sequence[float]) -> float:
    """Return the magnitude of the change of the components that are seen; NaN where none is.

    Infinite where one is beyond the range of the instrument; one that was so before is not seen.
    """
    squares = [
        (a - b) ** 2
        for a, b in zip(now, before, strict=True)
        if math.isfinite(b) and not math.isnan(a)
    ]
    return math.sqrt(sum(squares)) if squares else math.nan


class Witnesses:
    """The witnesses among a run's instruments, and what each saw of the sources that are driven.

    `earlier` is what they saw before an earlier process of the same run energised anything. Those
    who are informed get the sightings as plain data whenever they changed.
    """

    def __init__(self, clock: Clock, earlier: Mapping[str, Sequence[float]] | None = None) -> None:
        self._clock = clock
        self._earlier = dict(earlier or {})
        self.sightings: dict[str, Sighting] = {}
        self._instruments: dict[str, object] = {}
        self._driven: dict[str, Mapping[str, float]] = {}
        """Of each source that is driven, the change that each witness should see of it."""
        self._last: dict[str, list[float]] = {}
        self._to_read: set[str] = set()
        self._energised = False
        self._sent: dict[tuple[str, str], float] = {}
        self._informed: Callable[[list[dict[str, Any]]], None] = lambda sightings: None

    def informs(self, informed: Callable[[list[dict[str, Any]]], None]) -> None:
        """Have somebody informed of what is seen, now and from now on; it must return at once."""
        self._informed = informed
        self._inform()

    def open(self, instruments: Mapping[str, object]) -> None:
        """Read every witness, before anything is energised; raises InstrumentError."""
        for name, instrument in instruments.items():
            witness = witness_of(name)
            if witness is not None and witness.can_read(instrument):
                self._instruments[name] = instrument
                self._read_before(name)

    def drives(self, source: str, expected: Mapping[str, float]) -> None:
        """Take note that a source is about to be driven; none is any more where all expect zero.

        `expected`: the change that each witness should see of it. A witness that was moved is read
        once more first. Raises InstrumentError.
        """
        if not any(expected.values()):
            self._driven.pop(source, None)
            return
        if not self._driven:
            for name in sorted(self._to_read):
                self._read_before(name)
            self._to_read.clear()
        self._driven[source] = expected
        self._energised = True
        for name, sighting in self.sightings.items():
            if expected.get(name, 0.0) > sighting.expected.get(source, 0.0):
                sighting.expected[source] = expected[name]
                self._inform()

    def refuse_energised(self, sources: Mapping[str, Mapping[str, float]]) -> None:
        """Raise BenchEnergised where a witness sees what is left by an earlier process, or a sine.

        `sources`: of each source the largest change that each witness should see of it in this run.
        The end of the run does not call those sources safe then.
        """
        energised = []
        for name, sighting in self.sightings.items():
            of_sources = {
                s: expected[name] for s, expected in sources.items() if expected.get(name)
            }
            least, unit = MIN_SEEN * max(of_sources.values(), default=math.inf), sighting.unit
            earlier = self._earlier.get(name, ())
            if sighting.spread > least and (now := self._swings(name)) > least:
                sighting.energised = f"its readings differ by {now:.3g} {unit} at rest"
            elif (
                earlier
                and of_sources
                and (now := distance(as_turned(sighting.before, earlier), earlier))
                > beyond_turning(max(of_sources.values()), earlier)
            ):
                sighting.energised = f"{now:.3g} {unit} came since the run began"
            else:
                continue
            sighting.expected |= of_sources
            energised.append(f"the {name} sees that {sighting.energised}")
        if energised:
            self._inform()
            raise BenchEnergised(energised)

    def _swings(self, name: str) -> float:
        """Return how far readings lie from their middle now; one of them may be wild."""
        looks = several_looks(name, self._instruments[name], self._clock, LOOKS)
        middle = [sorted(component)[LOOKS // 2] for component in zip(*looks, strict=True)]
        return sorted(distance(look, middle) for look in looks)[-2]

    def moved(self, why: str, witness: str = "") -> None:
        """Forget what was seen: somebody or something moved. `witness`: only that one was."""
        for name, sighting in self.sightings.items():
            if witness in ("", name):
                sighting.lost |= dict.fromkeys(sighting.change, why)
                sighting.change.clear()
                self._last.pop(name, None)
                if witness or not self._energised:
                    self._to_read.add(name)
                self._inform()

    def came(self, name: str, rows: NDArray[Any]) -> None:
        """Take rows of a witness's record, shape (rows,): how far they are from before."""
        sighting = self.sightings.get(name)
        if sighting is None or not self._driven:
            return
        import numpy as np

        witness = witness_of(name)
        assert witness is not None
        seen = np.stack([rows[column] for column in witness.columns], axis=-1) * witness.scale
        seen = np.where(np.abs(seen) < OVERLOAD, seen, np.inf)
        before = [value if math.isfinite(value) else math.nan for value in sighting.before]
        far = np.sqrt(np.nansum((seen - np.array(before)) ** 2, axis=-1))
        several = np.array([*self._last.get(name, ()), *far[np.isfinite(far)]])
        self._last[name] = several[-2:].tolist()
        if len(several) < 3:
            return
        # The middle of three after each other: one wild reading is no change.
        middle = np.sort(np.stack([several[:-2], several[1:-1], several[2:]]), axis=0)[1]
        self._saw(sighting, float(middle.max()))

    def _saw(self, sighting: Sighting, change: float) -> None:
        for source, expected in self._driven.items():
            least = MIN_SEEN * expected.get(sighting.instrument, math.inf)
            known = sighting.change.get(source, 0.0)
            if change >= max(least, known):
                sighting.change[source] = change
                sighting.lost.pop(source, None)
                if change > GROWN * self._sent.get((sighting.instrument, source), 0.0):
                    self._inform()

    def testify(self) -> list[WitnessReport]:
        """Ask every witness now, when all is to be off."""
        return [
            judge(sighting, self._instruments.get(name), self._clock)
            for name, sighting in self.sightings.items()
        ]

    def _read_before(self, name: str) -> None:
        witness = witness_of(name)
        assert witness is not None
        looks = several_looks(name, self._instruments[name], self._clock, LOOKS_BEFORE)
        middle = [sorted(component)[LOOKS_BEFORE // 2] for component in zip(*looks, strict=True)]
        known = self.sightings.setdefault(name, Sighting(name, witness.unit, middle))
        known.before = middle
        known.spread = max(0.0, *(distance(look, looks[0]) for look in looks[1:]))
        known.expected.clear()
        self._inform()

    def _inform(self) -> None:
        self._sent = {
            (name, source): change
            for name, sighting in self.sightings.items()
            for source, change in sighting.change.items()
        }
        self._informed([sighting.to_data() for sighting in self.sightings.values()])


def contradicted(witness_reports: Collection[WitnessReport]) -> dict[str, str]:
    """Return what contradicts each source that reads back as off, in words."""
    against: dict[str, str] = {}
    for report in witness_reports:
        if report.agrees is False:
            for source in report.sources:
                against.setdefault(source, f"{report.instrument} sees that {report.sentence}")
    return against
