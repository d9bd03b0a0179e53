"""Red Pitaya STEMlab 125-14 with its SCPI server (TCP 5000, CR LF): one record about a trigger.

Sources: the maker's list of commands, its known issues, and the source of its server and gateware:
the 16384 values, the delay that is counted from the middle, the ring that is read from the pointer
kept at the trigger, that acquisition must be started anew for each record, that TD is also what a
board says that waits for nothing, that a floating pin reads 1, that the gain is set by jumpers and
`ACQ:SOUR1:GAIN` only names them. Servers ignore what they do not know, so everything that is set is
read back. Not confirmed: which version of the system keeps which pointer (taken to be 2.05).

Wiring: DIO0_N is the bench's trigger output; a wire leads from it to DIO0_P, the board's own
trigger input, so that time zero is the edge that everybody else gets. Sampling is not in step with
the trigger: `time_s` is up to half an interval early or late, the same for a whole record.

The board reports no serial number (`*IDN?` has 0 in its place, or nothing, which is made 0): its
address is all that distinguishes one from another.

Commands and their sources:
    *IDN? - who answers, without a serial number - the server's source - confirmed
    ACQ:RST, ACQ:START, ACQ:DEC, ACQ:DEC:F, ACQ:AVG, ACQ:DATA:UNITS, ACQ:SOUR1:GAIN - a record -
        the maker's list of commands - confirmed
    ACQ:TRIG, ACQ:TRIG:STAT?, ACQ:TRIG:FILL?, ACQ:TRIG:DLY - its trigger - the maker's list of
        commands - confirmed
    ACQ:SOUR1:DATA:START:N?, ACQ:SOUR1:DATA:STA:N? - values from a place on - the server's source -
        confirmed
    ACQ:WPOS?, ACQ:TPOS? - the pointers, which system keeps which - the server's source -
        not confirmed
    DIG:PIN, DIG:PIN:DIR - the trigger output - the maker's list of commands - confirmed
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.redpitaya.stemlab_settings import SLOTS, BoardSettings, CannotRecord, Record
from drivers.transport.exchanges import Repeatable, shortened
from drivers.transport.text_line import VisaLine, not_this_model
from station.roles import Block, Driver, Identity, Place, SafetyReading, quantity

Answer = TypeVar("Answer")

RECOGNISES = r"^REDPITAYA,INSTR\d+,(?P<serial>[^,]*)"
OUTPUT, LOOP = "DIO0_N", "DIO0_P"
END = "\r\n"
SLICE = 2048
"""Values in one answer, about 20 kB, which take the board some hundredths of a second."""

GRACE_S = 2.0
SETTLE_S = 1e-3
OTHERS = "see that nobody else uses the board, and that settings.os_version is its system's"
WIRE_UP = f"seat the wire between {OUTPUT} and {LOOP}"


class RedPitaya(Driver):
    """A recorder of one input about the trigger that it gives itself."""

    Settings = BoardSettings
    recognises: ClassVar[str] = RECOGNISES
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?|ACQ:(WPOS|TPOS|TRIG:(STAT|FILL))\?|DIG:PIN(:DIR)?\? \w+",
        r"ACQ:SOUR\d:DATA:STA(RT)?:N\? \d+,\d+",
        rf"DIG:PIN {OUTPUT},0",
    )
    source = "digitizer"
    columns: ClassVar[Mapping[str, str]] = {
        "time_s": "s since the trigger by the board's clock, ± half an interval for all alike",
        "voltage_V": "V at the input, mean over the interval about time_s; full scale when beyond",
    }

    def __init__(self, place: Place) -> None:
        self.place = place
        self._settings = self.Settings.of(place)
        self.full_scale_V = self._settings.full_scale_V
        """Where the range ends: values beyond are kept as this."""
        self._system = self._settings.system
        self._source = f"ACQ:SOUR{self._settings.channel}"
        self._record: Record | None = None
        self._fired_s: float | None = None
        # Held while a record is begun, and for the whole of a single look of an interlock's.
        self._turn = place.clock.lock(f"{place.name} record")
        self._line = VisaLine(
            place,
            request_end=END,
            answer_end=END,
            repeatable=self.repeatable,
            when_odd=OTHERS,
        )

    def identify(self) -> Identity:
        """Ask `*IDN?`: maker, model, a serial number that is 0, firmware."""
        answer = self._line.query("*IDN?")
        parts = [part.strip() for part in answer.split(",")]
        if len(parts) != 4 or parts[0] != "REDPITAYA":
            raise not_this_model(self.place.name, "asked *IDN?", answer)
        return Identity("Red Pitaya", "STEMlab 125-14", parts[2] or "0", f"{parts[1]} {parts[3]}")

    @classmethod
    def why_no_record(
        cls,
        settings: Mapping[str, Any],
        sample_rate_Hz: float,
        duration_s: float,
        full_scale_V: float,
    ) -> str | None:
        """Return why buffer or range do not hold a record, None where they do."""
        try:
            BoardSettings.read(settings).record(sample_rate_Hz, duration_s, full_scale_V)
        except CannotRecord as error:
            return f"{error.why}; {error.do_now}"
        return None

    def prepare(self, sample_rate_Hz: float, duration_s: float, full_scale_V: float) -> float:
        """Choose decimation and range, clear the last record; return the sample rate in Hz.

        The rate is the nearest at or above the wanted. Raises InstrumentError where the buffer or
        the range does not hold the record.
        """
        try:
            record = self._settings.record(sample_rate_Hz, duration_s, full_scale_V)
        except CannotRecord as error:
            wish = f"record {duration_s:g} s at {sample_rate_Hz:g} Hz up to {full_scale_V:g} V"
            raise self.error(wish, error.why, error.do_now) from None
        with self._turn:
            self._record, self._fired_s = None, None
            self._expect("reset it", "0", "ACQ:RST", "ACQ:TRIG:DLY?")
            for command, value in (
                (self._system.decimation_command, str(record.decimation)),
                ("ACQ:AVG", "ON"),
                ("ACQ:DATA:UNITS", "VOLTS"),
                (f"{self._source}:GAIN", self._settings.jumper),
                ("ACQ:TRIG:DLY", str(record.delay)),
            ):
                self._set(f"{command} {value}", f"{command}?", value)
            self._low()
            self._expect("drive its trigger output low", "0", f"DIG:PIN? {LOOP}", do_now=WIRE_UP)
            self._record = record
        return record.rate_Hz

    def fire(self) -> None:
        """Start the acquisition, wait for what comes before the trigger, and give it."""
        record = self._prepared("give the trigger")
        with self._turn:
            self._fired_s = None
            rest = f"DIG:PIN? {OUTPUT}"
            self._expect("arm it", "0", rest, do_now="release the trigger before")
            self._expect(
                "start the acquisition", "WAIT", "ACQ:START", "ACQ:TRIG EXT_PE", "ACQ:TRIG:STAT?"
            )
            if self._system.tells_full:
                self._expect("start the acquisition", "0", "ACQ:TRIG:FILL?")
            self.place.clock.sleep((record.before + 1) / record.rate_Hz + SETTLE_S)
            fired_s = self.place.clock.now()
            self._set(f"DIG:PIN {OUTPUT},1", f"DIG:PIN? {OUTPUT}", "1")
            self._expect("give the trigger", "TD", "ACQ:TRIG:STAT?", do_now=WIRE_UP)
            self._fired_s = fired_s

    def fetch(self) -> Block | None:
        """Return the record that was fired, None while it is being taken.

        Raises InstrumentError where nothing was fired, or no record comes.
        """
        record = self._prepared("fetch a record")
        if self._fired_s is None:
            raise self.error("fetch a record", "no trigger was given since the last one", "fire")
        if not self._is_full(record):
            return None
        pointer = self._whole("ACQ:TPOS?")
        start = pointer + self._system.first_after_trigger - record.before
        parts = [
            self._values(self._from((start + done) % SLOTS, min(SLICE, record.length - done)))
            for done in range(0, record.length, SLICE)
        ]
        self._fired_s = None
        volts = np.concatenate(parts)
        self.place.publish("voltage", float(volts[-1]), "V")
        times_s = (np.arange(record.length) - record.before) / record.rate_Hz
        return Block(
            {"time_s": times_s, "voltage_V": volts},
            np.full(record.length, self.place.clock.now()),
        )

    def release(self) -> None:
        """Take the trigger output back to rest, and see that it is there."""
        self._low()

    def make_safe(self, deadline_s: float) -> None:
        """Drive the trigger output low, so that nothing that listens goes on."""
        self._line.patiently(f"DIG:PIN {OUTPUT},0", self._low)

    def last_attempt(self) -> None:
        """Drive the trigger output low, and wait for no answer."""
        self._line.last_attempt(f"DIG:PIN {OUTPUT},0")

    def read_safety(self) -> SafetyReading:
        """Read back whether the trigger output is an output, and low."""
        way, level = self._line.proof.of(
            lambda: self._word(f"DIG:PIN:DIR? {OUTPUT}"),
            lambda: self._word(f"DIG:PIN? {OUTPUT}"),
        )
        words = {"0": "low", "1": "high"}
        return SafetyReading(
            way == "OUT" and level == "0",
            f"trigger output {words.get(level, level)}{'' if way == 'OUT' else ', not driven'}",
            dormant=way == "IN",
        )

    @quantity("voltage", "V")
    def _voltage_V(self) -> float | None:
        """Return the voltage at the input now; None before a record was prepared."""
        with self._turn:
            record = self._record
            if record is None:
                return None
            if self._fired_s is None:  # nothing is being taken that a look could spoil
                self._word(f"ACQ:START{END}ACQ:WPOS?")
                self.place.clock.sleep(2 / record.rate_Hz + SETTLE_S)
            newest = self._from(self._surely("ACQ:WPOS?", self._whole), 1)
            return float(self._surely(newest, self._values)[0])

    def _prepared(self, attempted: str) -> Record:
        if self._record is None:
            raise self.error(attempted, "no record was prepared", "prepare one before")
        return self._record

    def _is_full(self, record: Record) -> bool:
        assert self._fired_s is not None
        took_s = self.place.clock.now() - self._fired_s
        expected_s = (record.after + 2) / record.rate_Hz
        if not self._system.tells_full:
            return took_s > 1.001 * expected_s + SETTLE_S
        if self._whole("ACQ:TRIG:FILL?") == 1:
            return True
        if took_s > 1.1 * expected_s + GRACE_S:
            raise self.error(
                f"wait for a record of {expected_s:.3g} s",
                f"{took_s:.3g} s after the trigger ACQ:TRIG:FILL? still reads 0",
                OTHERS,
            )
        return False

    def _low(self) -> None:
        """Make the trigger output an output, drive it low, and read both back."""
        self._set(f"DIG:PIN:DIR OUT,{OUTPUT}", f"DIG:PIN:DIR? {OUTPUT}", "OUT")
        self._set(f"DIG:PIN {OUTPUT},0", f"DIG:PIN? {OUTPUT}", "0")

    def _set(self, command: str, question: str, wanted: str) -> None:
        self._expect(f"sent {command!r}", wanted, command, question)

    def _expect(self, attempted: str, wanted: str, *lines: str, do_now: str = OTHERS) -> None:
        """Send lines, the last of which is a question, and see that its answer is the wanted one.

        They go out together: one after the other they would wait for the network in between.
        """
        has = self._word(END.join(lines))
        if has != wanted:
            came = f"{lines[-1]} reads {shortened(has)!r} where {wanted} belongs"
            raise self.error(attempted, came, do_now)

    def _surely(self, question: str, ask: Callable[[str], Answer]) -> Answer:
        """Ask what does no harm twice, where one lost answer must not decide."""
        return self._line.patiently(question, lambda: ask(question))

    def _word(self, question: str) -> str:
        return self._line.query(question).strip()

    def _whole(self, question: str) -> int:
        answer = self._word(question)
        if not answer.isdecimal():
            raise self._line.odd(question, answer)
        return int(answer)

    def _from(self, start: int, count: int) -> str:
        """Return the question for `count` values of the ring from a place on."""
        return f"{self._source}:{self._system.data_query} {start},{count}"

    def _values(self, question: str) -> NDArray[np.float64]:
        """Return the values that were asked for, in V, shape (count,)."""
        count = int(question.rpartition(",")[2])
        answer = self._word(question)
        try:
            if not (answer.startswith("{") and answer.endswith("}")):
                raise ValueError
            values = np.array([float(text) for text in answer[1:-1].split(",")])
        except ValueError:
            raise self._line.odd(question, answer) from None
        if len(values) != count or not np.isfinite(values).all():
            raise self._line.odd(question, answer)
        return values
