"""Lake Shore F71 teslameter over TCP (SCPI, requests end with LF, answers with CR LF).

Sources: F71 manual and the maker's Python client for the buffer format and the error query. Not
confirmed in a primary source: which instant of the averaging the time stamp means; the bench
file's `timestamp` says it and the laboratory must have established it; and that `FETC:DC?` without
a parameter gives the newest magnitude and leaves the buffer alone; and the order of `FETC:DC? ALL`,
which is compared once with x, y, z asked singly, and noted. What outlasts a run is not documented:
mode, unit, averaging and range are put back as they were met.

Commands and their sources:
    *IDN? - who answers - F71 manual p.74, the maker's client - confirmed
    SYST:ERR:CLE, SYST:ERR:ALL? - the error queue - the maker's client - confirmed
    SENS:MODE, UNIT:FIELD, SENS:AVER:COUN, SENS:RANG, SENS:RANG:AUTO - the measurement - the maker's
        client - confirmed
    FETC:BUFF:DC? - the buffered readings - the maker's client - confirmed
    FETC:DC? - the magnitude now - F71 manual p.50 - confirmed
    FETC:DC? X|Y|Z|ALL - the components; the order of ALL - F71 manual p.50 - not confirmed
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.generic.three_axes import ThreeAxes, in_mT
from drivers.transport.exchanges import Repeatable, shortened
from drivers.transport.text_line import ScpiDriver, VisaSettings, identification
from station.fields import Second
from station.roles import Block, Identity, Place, quantity
from station.roles.patience import patience

READING_PERIOD_S = 0.01
SAME = 0.05
"""Of the largest component: two readings of one axis, one after the other, differ by less."""


class LakeshoreF71(ThreeAxes, ScpiDriver):
    """A gaussmeter that buffers averaged readings with its own time stamps."""

    class Settings(VisaSettings):
        """What its readings are averaged over, and what their stamps mean."""

        averaging_s: Second = Field(gt=0, description="of each reading, a multiple of 10 ms")
        timestamp: Literal["interval-start", "interval-middle", "interval-end"] = Field(
            description="the instant of the averaging that a time stamp means"
        )

    recognises: ClassVar[str] = r"^Lake ?Shore[^,]*,F71,(?P<serial>[^,/]+)"
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?|FETC:DC\?( X| Y| Z| ALL)?|SYST:ERR:(ALL\?|CLE)|(SENS|UNIT):[A-Z:]+\?",
        r"SENS:MODE DC|UNIT:FIELD TESLA|SENS:AVER:COUN \d+|SENS:RANG [\d.e+-]+",
    )
    """Not the buffer: reading empties it, and what was lost on its way is lost."""
    error_query = ":SYST:ERR:ALL?"
    no_error = "(?i).*no error"
    answer_end = "\r\n"
    columns: ClassVar[Mapping[str, str]] = {
        "instrument_time_s": "s by the instrument's clock, from its first stamp of the run",
        **ThreeAxes.components,
        "state": "1 the instrument's input state says overload, 0 it does not",
    }

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        settings = self.Settings.of(place)
        self.timestamp = settings.timestamp
        self._averaging_count = max(round(settings.averaging_s / READING_PERIOD_S), 1)
        self.averaging_s = self._averaging_count * READING_PERIOD_S
        self._first_stamp: datetime | None = None
        self._newest_s = -math.inf
        self._gives_tesla = self._order_known = False

    def identify(self) -> Identity:
        """Ask `*IDN?`: maker, model, serial number, options and firmware."""
        parts = identification(self.place.name, self._line.query("*IDN?"))
        return Identity(parts[0], parts[1], parts[2].split("/")[0], parts[-1])

    def start(self, largest_field_mT: float) -> None:
        """Select DC mode, tesla, averaging and the range, and empty the buffer."""
        if not self._order_known:
            # What was refused before must not be taken for a refusal of what follows.
            self._line.command("SYST:ERR:CLE")
        self._keep("SENS:MODE", "DC")
        self._keep("UNIT:FIELD", "TESLA")
        self._gives_tesla = True
        self._keep("SENS:AVER:COUN", str(self._averaging_count))
        # Put back in the reverse order: a range that is set ends the automatic one.
        self.kept.meet("SENS:RANG:AUTO", "0", *self._as("SENS:RANG:AUTO"))
        self.kept.meet("SENS:RANG", f"{largest_field_mT * 1e-3:.6g}", *self._as("SENS:RANG"))
        self._line.command(f"SENS:RANG {largest_field_mT * 1e-3:.6g}")
        self._look_at_order()
        self._line.query("FETC:BUFF:DC?")
        self._first_stamp = None
        self._newest_s = -math.inf

    def drain(self) -> Block:
        """Return the buffered readings; reading them empties the instrument's buffer."""
        answer = self._line.query("FETC:BUFF:DC?")
        arrival_s = self.place.clock.now()
        records = [record for record in answer.strip().strip('"').split(";") if record]
        rows = np.array([self._row(record) for record in records]).reshape(-1, 5)
        self._check_rising(rows[:, 0])
        return self.block(rows, arrival_s)

    @quantity("field", "mT")
    def _field_mT(self) -> float:
        """Return the magnitude of the field now; infinite where it is beyond the range.

        The buffer, which a step may be recording, stays as it is.
        """
        self._give_tesla()
        return in_mT(self._line.number("FETC:DC?"))

    @patience()
    def field_now_mT(self) -> tuple[float, float, float]:
        """Return the components of the field now; infinite beyond the range. The buffer stays."""
        self._give_tesla()
        ask = self._line.number
        return in_mT(ask("FETC:DC? X")), in_mT(ask("FETC:DC? Y")), in_mT(ask("FETC:DC? Z"))

    def _give_tesla(self) -> None:
        """Have a direct field in tesla: before that it is as somebody left it, perhaps in gauss."""
        if not self._gives_tesla:
            self._keep("SENS:MODE", "DC")
            self._keep("UNIT:FIELD", "TESLA")
            self._gives_tesla = True

    def _as(self, header: str) -> tuple[Callable[[], str], Callable[[str], None]]:
        """Return what reads a setting, and what writes it."""
        return (
            patience()(lambda: self._line.query(f"{header}?").strip()),
            patience()(lambda text: self._line.command(f"{header} {text}")),
        )

    def _keep(self, header: str, value: str) -> None:
        """Set what may outlast the run, so that it can be put back."""
        self.kept.set(header, value, *self._as(header))

    @patience()
    def _look_at_order(self) -> None:
        """Note once in which order `ALL` comes: as x, y, z do that are asked singly."""
        if self._order_known:
            return
        self._order_known = True
        ask = self._line.query
        every = [float(text) for text in ask("FETC:DC? ALL").split(",")]
        singly = [float(ask(f"FETC:DC? {axis}")) for axis in "XYZ"]
        near = max(map(abs, singly)) * SAME
        orders = [
            words
            for words, first in (("magnitude, x, y, z", 1), ("x, y, z", 0))
            if len(every[first : first + 3]) == 3
            and all(abs(a - b) <= near for a, b in zip(every[first:], singly, strict=False))
        ]
        order = orders[0] if len(orders) == 1 else "in an order that does not show"
        self.met(f"FETC:DC? ALL gives {order}")

    def _check_rising(self, instrument_time_s: NDArray[np.float64]) -> None:
        """Raise InstrumentError when stamps do not rise: an answer came twice, or out of turn."""
        if not len(instrument_time_s):
            return
        if not (np.diff(instrument_time_s, prepend=self._newest_s) > 0).all():
            raise self.error(
                "read its buffer",
                "its time stamps run backwards",
                "check that nobody else talks to the instrument, then run again",
            )
        self._newest_s = float(instrument_time_s[-1])

    def _row(self, record: str) -> tuple[float, float, float, float, float]:
        fields = record.split(",")
        try:
            stamp = datetime.fromisoformat(fields[0])
            x_T, y_T, z_T = (float(text) for text in fields[2:5])
            overload = float(fields[-1].strip() not in ("0", ""))
            if not all(map(math.isfinite, (x_T, y_T, z_T))):
                raise ValueError(record)
            self._first_stamp = self._first_stamp or stamp
            # A stamp with a time zone after stamps without one is no stamp of this instrument.
            instrument_time_s = (stamp - self._first_stamp).total_seconds()
        except (ValueError, IndexError, TypeError) as error:
            raise self.error(
                "read its buffer",
                f"{shortened(record)!r} is no reading",
                "check the cable and that nobody else talks to the instrument",
            ) from error
        return instrument_time_s, x_T, y_T, z_T, overload
