"""Lake Shore 425 gaussmeter with a probe of one axis, on its USB serial port.

57600 Bd, 7 data bits, odd parity, one stop bit. From its manual: the mnemonics, the form of numbers
and of the identity, that lines end with CR LF, that 30 ms must pass after each line before the next
is sent. From a public client: the ranges 35 G, 350 G, 3.5 kG and 35 kG of `RANGE 1` to `4`, which
are those of one kind of probe. From general knowledge: that filter 0 of `RDGMODE` is off. Not
confirmed in a primary source, and for the laboratory to establish: over which time a reading is
averaged and how often there is a new one; the bench file's `averaging` says both.

It knows no error queue, so every setting is read back, and each reading brings unit or mode along,
by turns: that shows an answer to the question before. That answers to queries in
one line are joined by `;` is from general knowledge. It keeps no readings and has no clock: each
`drain` asks for the newest reading and stamps it with the run time in the middle of the exchange.
The average had ended up to one `averaging` before. Which settings outlast
a run is not documented: unit, mode and range are put back as they were met.

Commands and their sources:
    *IDN? - who answers - 425 manual p.60 - confirmed
    RDGFIELD? - the newest reading - 425 manual p.64 - confirmed
    UNIT, UNIT? - 2 is tesla - 425 manual p.65 - confirmed
    RDGMODE, RDGMODE? - direct field, no filter - 425 manual p.64 - confirmed
    RANGE, RANGE? - 35 G, 350 G, 3.5 kG, 35 kG - public client code - not confirmed
    AUTO, AUTO? - the range stays - 425 manual p.50 - confirmed
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.transport.exchanges import Repeatable, shortened
from drivers.transport.ports import BaudRate, DataBits, Parity, SerialSettings
from drivers.transport.text_line import SerialLine, number_of
from station.errors import InputError
from station.fields import Second
from station.roles import Block, Driver, Identity, Place, published, quantity
from station.roles.patience import patience

PAUSE_S = 0.03
RANGES_T = (3.5e-3, 35e-3, 0.35, 3.5)
TESLA = "2"
DIRECT = "1,0"
"""Direct field, no filter; the band that follows concerns the other modes."""
WITNESSES = (("UNIT?", TESLA), ("RDGMODE?", DIRECT))
"""What is asked along with a reading, by turns, and how the answer begins."""
AXES = ("x", "y", "z")


class Lakeshore425(Driver):
    """A gaussmeter of one axis: a person turns its probe to the axis that is measured."""

    class Settings(SerialSettings):
        """What its readings are averaged over, and its line."""

        averaging_s: Second = Field(gt=0, description="of each reading, as set at its front panel")
        baud_rate: BaudRate = 57600
        data_bits: DataBits = 7
        parity: Parity = "O"

    recognises: ClassVar[str] = r"^LSCI,MODEL425,(?P<serial>[^,]+)"
    identifies_on: ClassVar[str] = "socket"
    """Where a scan of served instruments may ask `identify`."""
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"(\*IDN|RDGFIELD|UNIT|RANGE|AUTO|RDGMODE)\?",
        r"UNIT 2|RANGE [1-4]|AUTO 0|RDGMODE 1,0,1",
        rooted=False,
    )
    prompts: ClassVar[Mapping[str, str]] = {
        f"turn-probe-{axis}": f"Turn the probe of the gaussmeter so that it measures along the "
        f"normal of coil {axis.upper()}, positive in its direction; leave it where it is."
        for axis in AXES
    }
    """Every act this driver may ask for, so that a run can be checked before it begins."""
    axes: ClassVar[int] = 1
    keeps_readings: ClassVar[bool] = False
    timestamp = "on-request"
    source = "gaussmeter"
    columns: ClassVar[Mapping[str, str]] = {
        "instrument_time_s": "s of run time, in the middle of asking for the newest reading",
        **{
            f"{axis}_T": f"T along {axis}; NaN where the probe is turned elsewhere" for axis in AXES
        },
        "state": "1 the reading is beyond the range that was chosen, 0 it is not",
    }

    def __init__(self, place: Place) -> None:
        self.place = place
        settings = self.Settings.of(place)
        self.averaging_s = settings.averaging_s
        self._axis = "x"
        self._turned = False
        self._range_T = RANGES_T[-1]
        self._gives_tesla = False
        self._readings = 0
        self._turn = place.clock.lock(f"{place.name} turn")
        self._line = SerialLine(
            place, settings, request_end="\r\n", repeatable=self.repeatable, pause_s=PAUSE_S
        )

    def identify(self) -> Identity:
        """Ask `*IDN?`: maker, model, serial number and firmware."""
        answer = self._ask("*IDN?")
        parts = [part.strip() for part in answer.split(",")]
        if len(parts) != 4 or not re.match(self.recognises, answer):
            raise self._line.odd("*IDN?", answer)
        return Identity(parts[0], parts[1], parts[2], parts[3])

    def turn_to(self, axis: str) -> None:
        """Ask for the probe to be turned, unless it was turned there last."""
        if self._turned and axis == self._axis:
            return
        self.place.ask(f"turn-probe-{axis}", self.prompts[f"turn-probe-{axis}"])
        self._axis, self._turned = axis, True
        # The newest average may have ended one averaging ago, and have begun before the turn.
        self.place.clock.sleep(2.0 * self.averaging_s)

    def start(self, largest_field_mT: float) -> None:
        """Select tesla, direct field without filter, and the range; each is read back."""
        largest_T = largest_field_mT * 1e-3
        fitting = [range_T for range_T in RANGES_T if largest_T <= range_T]
        if not fitting:
            raise InputError(
                f"{self.place.name}: it measures up to {RANGES_T[-1]:g} T, not {largest_T:g} T"
            )
        self._range_T = fitting[0]
        self._prepare()
        # Put back in the reverse order: a range that is set ends the automatic one.
        self._keep("AUTO", "0")
        self._keep("RANGE", str(RANGES_T.index(self._range_T) + 1))

    def drain(self) -> Block:
        """Return the newest reading, one row."""
        if not self._gives_tesla:
            self._prepare()
        field_T, time_s = self._newest()
        self._shown_mT(field_T)
        row = {
            "instrument_time_s": time_s,
            **{f"{axis}_T": field_T if axis == self._axis else math.nan for axis in AXES},
            "state": float(abs(field_T) > self._range_T),
        }
        columns = {name: np.array([value], dtype=float) for name, value in row.items()}
        return Block(columns, np.array([self.place.clock.now()]))

    @quantity("field", "mT")
    def _field_mT(self) -> float:
        """Return the magnitude of the field along the probe now; infinite beyond the range.

        Before the first start it is as somebody left it, perhaps in gauss: then it is set first.
        """
        return self._shown_mT(self._now_T())

    def field_now_mT(self) -> tuple[float, float, float]:
        """Return the field along the probe's axis now, NaN along the others; infinite beyond."""
        field_T = self._now_T()
        field_mT = field_T * 1e3 if abs(field_T) <= self._range_T else math.inf
        x_mT, y_mT, z_mT = (field_mT if axis == self._axis else math.nan for axis in AXES)
        return x_mT, y_mT, z_mT

    @patience()
    def _now_T(self) -> float:
        if not self._gives_tesla:
            self._prepare()
        return self._line.patiently("RDGFIELD?", self._newest)[0]

    def _prepare(self) -> None:
        self._keep("UNIT", TESLA)
        self._keep("RDGMODE", f"{DIRECT},1")
        self._gives_tesla = True

    def _keep(self, name: str, value: str) -> None:
        """Set what may outlast the run, so that it can be put back."""
        query = f"{name}?"
        self.kept.set(
            name,
            value,
            patience()(lambda: self._ask(query).replace(" ", "")),
            lambda text: self._set(f"{name} {text}", query, text),
        )

    @patience()
    def _set(self, command: str, query: str, wanted: str) -> None:
        """Send a command and prove by its query that it was taken."""

        def exchange() -> None:
            self._tell(command)
            self._check(f"sent {command!r}", query, self._ask(query), wanted)

        self._line.patiently(command, exchange)

    def _check(self, attempted: str, query: str, answer: str, wanted: str) -> None:
        """Raise InstrumentError where an answer does not begin as wanted."""
        if not f"{answer.replace(' ', '')},".startswith(f"{wanted},"):
            raise self.error(
                attempted,
                f"{query} answers {shortened(answer)!r}, not {wanted}",
                "check its cable, that the model is a 425, and that nobody else uses it",
            )

    def _newest(self) -> tuple[float, float]:
        """Return the newest reading, T, and the run time in the middle of asking for it."""
        query, wanted = WITNESSES[self._readings % len(WITNESSES)]
        self._readings += 1
        answer, time_s = self._timed(f"RDGFIELD?;{query}")
        reading, _, witness = answer.partition(";")
        self._check("read the field", query, witness, wanted)
        return number_of(self.place.name, "RDGFIELD?", reading), time_s

    @published("field", "mT")
    def _shown_mT(self, field_T: float) -> float:
        return abs(field_T) * 1e3 if abs(field_T) <= self._range_T else math.inf

    def _ask(self, message: str) -> str:
        return self._timed(message)[0]

    def _timed(self, message: str) -> tuple[str, float]:
        """Return the answer to a query, and the run time in the middle of the exchange."""
        clock = self.place.clock
        with self._turn:
            self._line.keep_pause()
            asked_s = clock.now()
            answer = self._line.query(message)
            return answer, 0.5 * (asked_s + clock.now())

    def _tell(self, message: str) -> None:
        with self._turn:
            self._line.write(message)
