"""KVH 1775 fibre-optic IMU on RS-422, nine axes in frames of format C.

921600 Bd, 8 data bits, no parity, one stop bit unless the bench file says otherwise. From the
interface control document ICD 56-0298 Rev B and public clients. A frame has the header FE 81 FF 57,
three gyros and three accelerometers as floats, one further float, status, sequence number 0 to 127
and CRC-32/MPEG-2: 38 bytes. The further float is by turns the temperature and the magnetometers X,
Y, Z in gauss. Not confirmed in a primary source: that a bit of a built-in test is set while the
part is well, the highest bit of each byte aside.

The unit streams from power-up on, one frame of its built-in test first, in the format that was set
last: A (36 bytes), B (40, with a time stamp) or C. This driver keeps it in its configuration mode,
where it is quiet, until it is started, and lets it stream again when it is closed. The unit never
answers `=CONFIG,0`: that it streams again is proved by a frame.

The unit keeps its settings without power. Those that outputs hang on are read, set for the run and
put back at its end; whatever is set is compared with what the unit answers. The types of its
filters are left as they are, because a custom filter cannot be written again, and reported.

Commands and their sources:
    =CONFIG,1, =CONFIG,0 - configuration mode, and back without an answer - ICD 56-0298 B p.32 -
        confirmed
    ?IS - serial number - ICD 56-0298 B p.54 - confirmed
    ?WS - firmware, five lines - ICD 56-0298 B p.54 - confirmed
    ?BIT - built-in test, in normal mode alone - ICD 56-0298 B p.26, 31 - confirmed
    =OUTPUTFMT,C - frames with magnetometers - ICD 56-0298 B p.55 - confirmed
    =ROTFMT,RATE - rates, not angles - ICD 56-0298 B p.55 - confirmed
    =ROTUNITS,DEG - degrees - ICD 56-0298 B p.55 - confirmed
    =LINFMT,ACCEL - accelerations in g, so that LINUNITS does not matter - ICD 56-0298 B p.55 -
        confirmed
    =TEMPUNITS,C - degC - ICD 56-0298 B p.55 - confirmed
    =AXES,1,0,0,0,1,0,0,0,1 - axes as they are built in - ICD 56-0298 B p.30, 55, 56 - confirmed
    =FILTEN,1 - filters on - ICD 56-0298 B p.55 - confirmed
    =MSYNC,IMU - outputs by its own clock - ICD 56-0298 B p.55 - confirmed
    =DR - outputs per second - ICD 56-0298 B p.33 - confirmed
    ?FILTTYPE,A, ?FILTTYPE,G - types of the filters - ICD 56-0298 B p.44 - confirmed
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from drivers.generic.nine_axis import ACCELEROMETERS, GYROS, MAGNETOMETERS, ROW, NineAxisSource
from drivers.kvh.imu_1775_frames import OTHER_OUTPUT, OUTPUT, PAYLOAD, SELF_TEST, TEXT, split
from drivers.transport.exchanges import Repeatable
from drivers.transport.ports import BaudRate, SerialSettings
from drivers.transport.serial_stream import Counting, Numbering, SerialStream, StreamFrame
from station.errors import InputError, InstrumentError, InstrumentTimeout
from station.roles import Identity, Place, SensorStatus

LOOK_S = 0.005
RATES_HZ = (1, 5, 10, 25, 50, 100, 250, 500, 750, 1000)
"""Of 3600 and 5000 frames a second 921600 Bd carries too few."""

AS_BUILT = ",".join(f"{float(row == column):+.6E}" for row in range(3) for column in range(3))
SETTINGS = {
    "MSYNC": "IMU",
    "OUTPUTFMT": "C",
    "ROTFMT": "RATE",
    "ROTUNITS": "DEG",
    "LINFMT": "ACCEL",
    "TEMPUNITS": "C",
    "AXES": AS_BUILT,
    "FILTEN": "1",
}
"""In the order in which they are set; MSYNC first, because it may change the filters."""

FILTERS = {"A": "accelerometers", "G": "gyros"}
MODEL_LINE, LINES_OF_FIRMWARE = "1775 IMU", 5
REFUSALS = ("INVALID", "USAGE", "ERROR")
NT_PER_GAUSS = 1e5
VALID_BITS = 0x77
BITS_IN_USE = 7
MODULUS = 128
"""Of the sequence number of frames."""


class Kvh1775(NineAxisSource):
    """A KVH 1775 whose gyros give deg/s, accelerometers g and magnetometers gauss."""

    class Settings(SerialSettings):
        """Its line."""

        baud_rate: BaudRate = 921600

    repeatable: ClassVar[Repeatable] = Repeatable("stop", "identify", "status")
    """Not the start, which sets the counter back."""
    identifies_on: ClassVar[str] = "socket"
    """Where a scan of served instruments may ask `identify`; it knows no `*IDN?`."""

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        self._stream = SerialStream(place, self.Settings.of(place), split)
        self._sequence = Numbering(1.0, MODULUS)
        self._identity: Identity | None = None
        self._configures = False
        self._came: list[StreamFrame] = []
        """Outputs that came while a first one was waited for, and that nobody has taken yet."""

    def identify(self) -> Identity:
        """Ask for serial number and firmware; a unit that streams is not disturbed twice."""
        if self._identity is None:
            runs = self._streams
            self._configure()
            serial, firmware = self._ask("?IS", "IS"), self._firmware()
            self._identity = Identity("KVH", "1775", serial, firmware)
            if runs:
                self._leave()
        return self._identity

    @classmethod
    def rates_said(cls, rate_Hz: float) -> str:
        """Return in words which rates it has where this is none of them, else nothing."""
        if rate_Hz in RATES_HZ:
            return ""
        there_are = ", ".join(str(possible_Hz) for possible_Hz in RATES_HZ)
        return f"a KVH 1775 outputs {there_are} times a second, not {rate_Hz:g} times"

    def start(self, rate_Hz: float) -> None:
        """Begin to output, the counter from 1; raises InputError for a rate it does not have."""
        if refusal := self.rates_said(rate_Hz):
            raise InputError(f"{self.place.name}: {refusal}; change the plan's sample_rate")
        self._configure()
        for name, value in {**SETTINGS, "DR": f"{rate_Hz:.0f}"}.items():
            self.kept.set(name, value, partial(self._setting, name), partial(self._set, name))
        self.met(f"filters: {self._filters()}")
        self._forget_outputs()
        self._sequence = Numbering(1.0 / rate_Hz, MODULUS)
        self._begin(rate_Hz)
        self._leave(rate_Hz)

    def stop(self) -> None:
        """End the output; what came before can still be drained."""
        self._streams = False
        self._configure()

    def status(self) -> SensorStatus:
        """Ask for the built-in test, for which a unit that is quiet streams a moment."""
        quiet = self._configures
        if quiet:
            before = [*self._came, *self._stream.take(OUTPUT)]
            self._leave()
        self._stream.take(SELF_TEST)
        self._send("?BIT")
        frames = self._stream.wait_for(SELF_TEST, self._deadline_s())
        if quiet:
            self._configure()
            self._forget_outputs()
            self._came = before
        if not frames:
            raise self._silent("?BIT", "built-in test")
        failed = [
            f"built-in test, byte {place}, bit {bit}"
            for place, byte in enumerate(frames[-1].payload, 1)
            for bit in range(BITS_IN_USE)
            if not byte >> bit & 1
        ]
        return SensorStatus(tuple(failed))

    def close(self) -> None:
        """Let it stream again as after power-up, and close the line."""
        if self._configures:
            with suppress(InstrumentError):
                self._send("=CONFIG,0")
        self._stream.close()

    def _take(self) -> NDArray[np.void]:
        came, self._came = self._came, []
        return self._rows([*came, *self._stream.take(OUTPUT)], self._sequence.numbers)

    def _newest(self) -> NDArray[np.void]:
        newest = self._stream.newest(OUTPUT) or (self._came[-1] if self._came else None)
        return self._rows([] if newest is None else [newest], self._sequence.looked_at)

    def _rows(self, frames: Sequence[StreamFrame], count: Counting) -> NDArray[np.void]:
        """Return outputs of ROW; an output that comes twice or too late is left out."""
        data = np.frombuffer(b"".join(frame.payload for frame in frames), dtype=PAYLOAD)
        rows = np.zeros(len(data), dtype=ROW)
        arrival_s = np.array([frame.arrival_s for frame in frames], dtype=np.float64)
        rows["arrival_s"] = arrival_s
        for k, (gyro, force) in enumerate(zip(GYROS, ACCELEROMETERS, strict=True)):
            rows[gyro], rows[force] = data["gyro"][:, k], data["force"][:, k]
        turn = data["seq"] % 4
        further = data["further"].astype(np.float64)
        rows["temperature_degC"] = np.where(turn == 0, further, np.nan)
        for k, name in enumerate(MAGNETOMETERS, 1):
            rows[name] = np.where(turn == k, further * NT_PER_GAUSS, np.nan)
        rows["status"] = ~data["status"] & VALID_BITS
        numbers, new = count(data["seq"], arrival_s)
        rows["counter"] = numbers & 0xFFFF
        return np.asarray(rows[new])

    def _configure(self) -> None:
        self._ask("=CONFIG,1", "CONFIG")
        self._configures = True

    def _leave(self, rate_Hz: float = 0.0) -> None:
        """Leave the configuration mode, which is not answered, and wait for an output."""
        self._stream.take(OTHER_OUTPUT)
        self._came += self._stream.take(OUTPUT)
        self._send("=CONFIG,0")
        self._configures = False
        interval_s = 1.0 / (rate_Hz or RATES_HZ[0])
        until_s = self._deadline_s() + interval_s
        while not (frames := self._stream.take(OUTPUT, OTHER_OUTPUT)):
            if self.place.clock.now() >= until_s:
                raise self._silent(
                    "=CONFIG,0", "output", self.place.exchanges.deadline_s + interval_s
                )
            self.place.clock.sleep(LOOK_S)
        self._came += [frame for frame in frames if frame.kind == OUTPUT]

    def _forget_outputs(self) -> None:
        self._came = []
        self._stream.take(OUTPUT, OTHER_OUTPUT)

    def _setting(self, name: str) -> str:
        """Return what a setting is now, in the form in which it is written."""
        if not self._configures:
            self._configure()
        return canonical(name, self._ask(f"?{name}", name))

    def _set(self, name: str, value: str) -> None:
        answer = canonical(name, self._ask(f"={name},{value}", name))
        if answer != value:
            raise self._unfit(f"set {name} to {value}", answer)

    def _filters(self) -> str:
        """Return in words which filters the unit has."""
        types = []
        for letter, of in FILTERS.items():
            try:
                answer = self._ask(f"?FILTTYPE,{letter}", "FILTTYPE")
            except InstrumentTimeout:
                raise
            except InstrumentError:
                return "not read"
            types.append(f"{answer.rpartition(',')[2]} for {of}")
        return ", ".join(types)

    def _firmware(self) -> str:
        """Return the four versions of a unit, of which the model is the first line."""
        self._stream.take(TEXT)
        self._send("?WS")
        lines: list[str] = []
        deadline_s = self._deadline_s()
        while len(lines) < LINES_OF_FIRMWARE:
            frames = self._stream.wait_for(TEXT, deadline_s)
            if not frames:
                raise self._silent("?WS", "answer of five lines")
            lines += [frame.payload.decode("ascii").strip() for frame in frames]
        if lines[0].upper() != MODEL_LINE:
            raise self._unfit("sent ?WS", lines[0])
        return "; ".join(lines[1:])

    def _ask(self, text: str, name: str) -> str:
        """Send a line and return the value that is answered under a name."""
        self._stream.take(TEXT)
        self._send(text)
        deadline_s = self._deadline_s()
        while frames := self._stream.wait_for(TEXT, deadline_s):
            for answer in (frame.payload.decode("ascii") for frame in frames):
                key, _, value = answer.partition(",")
                if key == name:
                    return value.strip()
                if key.startswith(REFUSALS):
                    raise self._unfit(f"sent {text}", answer)
        raise self._silent(text, "answer")

    def _send(self, text: str) -> None:
        self._stream.send(f"{text}\n".encode("ascii"))

    def _deadline_s(self) -> float:
        clock = self.place.clock
        return clock.now() + clock.patience_s(self.place.exchanges.deadline_s)

    def _unfit(self, attempted: str, answer: str) -> InstrumentError:
        return self.error(
            attempted,
            f"it answered {answer!r}",
            "check that the unit is a 1775 and this driver fits its firmware",
        )

    def _silent(self, text: str, answer: str, within_s: float | None = None) -> InstrumentTimeout:
        within_s = self.place.exchanges.deadline_s if within_s is None else within_s
        return InstrumentTimeout(
            self.place.name,
            f"sent {text}",
            f"no {answer} came within {within_s:g} s",
            "check that the device under test is on, its cable and the baud rate",
        )


def canonical(name: str, value: str) -> str:
    """Return a setting in capitals, and the numbers of AXES as the unit writes them."""
    if name != "AXES":
        return value.upper()
    try:
        return ",".join(f"{float(number):+.6E}" for number in value.split(","))
    except ValueError:
        return value
