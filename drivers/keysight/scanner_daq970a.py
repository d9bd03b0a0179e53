"""Keysight DAQ970A (SCPI over TCP, lines end with LF): a scanner of platinum thermometers.

Each place has a Pt100 with four wires: channel n of a DAQM900A or DAQM901A carries its current,
channel n+10 senses it. A reading is one scan of all places, one after another. Resistances are
read, and become temperatures by IEC 60751 with the sensor's own resistance at 0 degC.

There is no `*RST`, which would take what others have set on other channels; a scan that runs is
ended. What the meter keeps of these channels, its scan list, trigger and format of readings are put
back as they were met; a range that was automatic comes back as the range that it was.

Guide: DAQ970A/DAQ973A programming guide, as printed. Clients: public programs for the DAQ970A, and
PyMeasure and others for the 34970A, whose language it is. Not confirmed: that four-wire resistance
is always zeroed, how long a channel takes beside that, the form of `CONF?` on a channel.

Commands and their sources:
    *IDN?, *CLS, SYST:ERR? - who answers, the error queue - guide p.149, clients - confirmed
    SYST:CTYP? 1 - the module in a slot, `Keysight Technologies,DAQM901A,MY58022244,01.02`, `0` for
        the model of an empty one - clients, one with the answers of its unit - confirmed
    SYST:LFR? - the frequency of the mains - 34970A client - not confirmed
    CONF? (@101), CONF:FRES - a channel as it was met; four-wire resistance - guide p.240, clients -
        confirmed
    FRES:NPLC, FRES:RANG? - 0.02 to 200 cycles with a list of channels - guide p.240, clients -
        confirmed
    CALC:SCAL:STAT - no scaling of a channel - client of the DAQ970A, PyMeasure - confirmed
    ROUT:SCAN - the scan list, answered as `#214(@101,102,103)` in the order of the channels -
        guide p.215, clients - confirmed
    FORM:READ:CHAN, FORM:READ:UNIT, FORM:READ:TIME, FORM:READ:ALAR - each reading with its channel
        alone; CONF switches that off - guide p.139, clients - confirmed
    TRIG:SOUR, TRIG:COUN - as many scans as asked for - guide p.342, clients - confirmed
    INIT, ABOR, STAT:OPER:COND?, DATA:POIN?, FETC? - start, poll (16 scans, 32 waits for its
        trigger), fetch - guide p.109, 215, 295, clients - confirmed
    DATA:LAST? (@101) - the last reading of a channel; an error where there is none - guide p.109 -
        confirmed
    9.9E+37 - an overload, as of an open sensor - guide p.227 - confirmed
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, WithJsonSchema, field_validator

from drivers.generic.burst_meter import (
    MAX_READINGS,
    NO_READING,
    BurstMeter,
    Function,
    MainsSettings,
    is_overload,
)
from drivers.generic.platinum import (
    HOTTEST_DEGC,
    R0,
    WIRES,
    impossible,
    resistance_ohm,
    temperature_degC,
)
from drivers.transport.exchanges import Repeatable
from station.fields import StrictModel
from station.roles import Block, Place, quantity
from station.roles.multimeter import DEVICE, is_at_device, place_columns

INTEGRATION_CYCLES = (0.02, 0.2, 1.0, 2.0, 10.0, 20.0, 100.0, 200.0)
OHMS = Function("FRES", "ohm", (100.0, 1e3, 1e4, 1e5), (120.0, 1.2e3, 1.2e4, 1.2e5))
PAIRED = {"DAQM900A": 10, "DAQM901A": 10, "DAQM902A": 8}
"""Modules by how many of their channels, counted from 1, measure with four wires."""
STILL_AT_IT = 16 | 32
MODULES, MOST_CHANNELS = 3, 10
SHOWN = {"FORM:READ:CHAN": "1", "FORM:READ:UNIT": "0", "FORM:READ:TIME": "0", "FORM:READ:ALAR": "0"}
LIST = re.compile(r"(?:#\d+)?(\(@[\d,:]*\))")
ENDLESS = 9.9e36
"""From here on `TRIG:COUN?` says INFinity."""


def integrates_over(nplc: float) -> float:
    """Return an integration time that the scanner has; raise ValueError for another."""
    if nplc not in INTEGRATION_CYCLES:
        known = ", ".join(f"{cycles:g}" for cycles in INTEGRATION_CYCLES)
        raise ValueError(f"it cannot integrate over nplc {nplc:g}; it can do {known}")
    return nplc


def of_four_wires(channel: int) -> int:
    """Return a channel that can have a sensor with four wires; raise ValueError for another."""
    slot, number = divmod(channel, 100)
    if not (1 <= slot <= MODULES and 1 <= number <= MOST_CHANNELS):
        raise ValueError(
            f"{channel} is no channel for four wires; they are s01 to s{MOST_CHANNELS} in the "
            f"slots s from 1 to {MODULES}, the sense wires {MOST_CHANNELS} channels higher"
        )
    return channel


Channel = Annotated[int, AfterValidator(of_four_wires)]
NAMED = r"^[a-z][a-z0-9]*(_[a-z0-9]+)*$"


def name_of_place(name: str) -> str:
    """Return the name of a place; raise ValueError for none, and for one that looks another way.

    A `device2` would be elsewhere, and its spread in no budget, without a word.
    """
    if not re.fullmatch(NAMED, name):
        raise ValueError(
            f"'{name}' is no name of a place; small letters and digits make one, joined by _ as in "
            "device_far"
        )
    if name.startswith(DEVICE) and not is_at_device(name):
        raise ValueError(
            f"'{name}' would not count as a place at the device: those begin with device_; call it "
            "so, or begin the name of a place elsewhere with another word"
        )
    return name


Name = Annotated[
    str, AfterValidator(name_of_place), WithJsonSchema({"type": "string", "pattern": NAMED})
]


class Sensor(StrictModel):
    """The channel of a place, and its sensor where that is no usual Pt100."""

    channel: Channel
    r0_ohm: R0 = 100.0


def degC_or_nan(sensor: Sensor, ohms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return temperatures in degC, NaN for a resistance that no Pt100 has; shape as `ohms`."""
    read = [impossible(ohms[n : n + 1], sensor.r0_ohm) is None for n in range(len(ohms))]
    degC = np.full(len(ohms), np.nan)
    degC[read] = temperature_degC(ohms[read], sensor.r0_ohm)
    return degC


class KeysightDaq970A(BurstMeter):
    """Platinum thermometers at several places, those at the device among them.

    The place `device` is what is read of the device's temperature; those whose name begins with
    `device_`, such as `device_far`, are at the device, too. Others, such as `chamber`, are not.
    """

    class Settings(MainsSettings):
        """The places with their channels and sensors, and how they are measured."""

        places: dict[Name, Channel | Sensor] = Field(
            min_length=1,
            description="each place's channel, or its `channel` and the `r0` of its sensor; "
            "`device` must be there, and those at the device begin with `device_`",
        )
        nplc: Annotated[float, AfterValidator(integrates_over)] = Field(
            10.0, description="integration time in power-line cycles"
        )

        @field_validator("places")
        @classmethod
        def with_a_device(cls, places: dict[str, int | Sensor]) -> dict[str, int | Sensor]:
            """Refuse places of which none is the device's, and two at the same channel."""
            if DEVICE not in places:
                raise ValueError(f"there is no place '{DEVICE}'; name the one whose reading counts")
            channels = [sensor_of(given).channel for given in places.values()]
            twice = next((one_of for one_of in channels if channels.count(one_of) > 1), None)
            if twice is not None:
                raise ValueError(f"two places are at the channel {twice}")
            return places

    recognises: ClassVar[str] = r"^Keysight Technologies,DAQ97[03]A,(?P<serial>[^,]+)"
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?|\*CLS|SYST:(ERR|LFR)\?|SYST:CTYP\? \d|STAT:OPER:COND\?|DATA:POIN\?|FETC\?",
        r"(CONF|FRES:NPLC|FRES:RANG|DATA:LAST|CALC:SCAL:STAT)\? \(@[\d,]+\)|[A-Z:]+\?",
        r"ABOR|TRIG:COUN \d+|INIT",
    )
    """Scans that are begun again consist of fresh readings: nothing is counted twice."""
    function = OHMS
    integration_cycles: ClassVar[tuple[float, ...]] = INTEGRATION_CYCLES
    source = "thermometer"

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        settings = self.Settings.of(place)
        self._nplc = settings.nplc
        given = {name: sensor_of(at) for name, at in settings.places.items()}
        # The device comes first: its is the reading that is watched.
        self._sensors = {DEVICE: given[DEVICE], **given}
        self.inputs = len(self._sensors)
        self.columns: Mapping[str, str] = dict(_columns(self._sensors))
        numbers = sorted(sensor.channel for sensor in self._sensors.values())
        self._list = f"(@{','.join(map(str, numbers))})"
        hottest_ohm = max(resistance_ohm(HOTTEST_DEGC, s.r0_ohm) for s in self._sensors.values())
        self._range_ohm = OHMS.range_for(hottest_ohm) or OHMS.ranges[-1]
        self._known = False

    def start(self, readings: int) -> None:
        """Begin so many scans of all places; returns at once."""
        most = MAX_READINGS // self.inputs
        if readings > most:
            raise self.error(
                f"take {readings} scans of {self.inputs} places",
                f"it can be asked for {most}",
                "split the measurement into several bursts",
            )
        self._prepare()
        self._begin(readings)

    def fetch(self) -> Block | None:
        """Return the scans that were started, None while they are being taken.

        A place whose sensor has no resistance of a Pt100 has NaN for a temperature; where that is
        `device`, InstrumentError is raised.
        """
        ohms = self._values()
        if ohms is None:
            return None
        columns: dict[str, NDArray[Any]] = {}
        for (place, sensor), read in zip(self._sensors.items(), ohms.T, strict=True):
            resistance, temperature = place_columns(place)
            to_degC = self._degC if place == DEVICE else degC_or_nan
            columns |= {resistance: read, temperature: to_degC(sensor, read)}
        device = columns[place_columns(DEVICE)[1]]
        self.place.publish("temperature", float(device[-1]), "degC")
        return Block(columns, np.full(len(ohms), self.place.clock.now()))

    @quantity("temperature", "degC")
    def _temperature_now_degC(self) -> float | None:
        """Return the temperature at `device`."""
        self._prepare()
        ohms = self._value_now()
        if ohms is None:
            return None
        return float(self._degC(self._sensors[DEVICE], np.array([ohms]))[0])

    def _prepare(self) -> None:
        self._choose(self._range_ohm, self._nplc, None, once=True)

    def _degC(self, sensor: Sensor, ohms: NDArray[np.float64]) -> NDArray[np.float64]:
        attempted = f"measured the Pt100 of the place {DEVICE}, channel {sensor.channel}"
        overload = ohms[is_overload(ohms)]
        if len(overload):
            raise self.error(attempted, f"{overload[0]:+.1E}, an overload: it is open", WIRES)
        wrong = impossible(ohms, sensor.r0_ohm)
        if wrong is not None:
            raise self.error(attempted, wrong, WIRES)
        return temperature_degC(ohms, sensor.r0_ohm)

    def _set_up(self, range_: float, nplc: float, auto_zero: bool | None) -> None:
        if not self._known:
            self._check_modules()
            self._meet()
        for message in (
            "ABOR",
            f"CONF:FRES {range_:g},DEF,{self._list}",
            f"FRES:NPLC {nplc:g},{self._list}",
            f"CALC:SCAL:STAT OFF,{self._list}",
            f"ROUT:SCAN {self._list}",
            "TRIG:SOUR IMM",
            *(f"{header} {value}" for header, value in SHOWN.items()),
        ):
            self._line.command(message)
        for header, wanted in (("FRES:RANG", range_), ("FRES:NPLC", nplc)):
            for sensor, has in zip(
                sorted(self._sensors.values(), key=lambda sensor: sensor.channel),
                self._line.numbers(f"{header}? {self._list}"),
                strict=False,
            ):
                agrees = abs(has - wanted) <= 1e-6 * wanted
                what = f"{header} of channel {sensor.channel}"
                self.check_set(what, f"{wanted:g}", f"{has:g}", agrees=agrees)
        for header, value in {"ROUT:SCAN": self._list, **SHOWN}.items():
            has_text = self._has(header)
            self.check_set(header, value, has_text, agrees=value == has_text)
        self._known = True

    def _check_modules(self) -> None:
        """Raise InstrumentError for a place at a channel that its module has not."""
        models: dict[int, str] = {}
        for place, sensor in self._sensors.items():
            slot, number = divmod(sensor.channel, 100)
            if slot not in models:
                question = f"SYST:CTYP? {slot}"
                fields = self._line.query(question).replace('"', "").split(",")
                if len(fields) < 2:
                    raise self._line.odd(question, ",".join(fields))
                models[slot] = fields[1].strip()
            if number > PAIRED.get(models[slot], 0):
                there = "no module" if models[slot] == "0" else f"a {models[slot]}"
                raise self.error(
                    f"looked for the channel {sensor.channel} of the place {place}",
                    f"there is {there} in slot {slot}, which measures no four wires at it",
                    f"correct settings.places.{place}, or put a DAQM901A or DAQM900A there",
                )

    def _meet(self) -> None:
        """Remember what is put back: the channels first, as CONF changes list and format, too."""
        meet = self.kept.meet
        for header, value in {**SHOWN, "TRIG:SOUR": "IMM"}.items():
            meet(header, value, partial(self._has, header), partial(self._write, header))
        meet("TRIG:COUN", "as the plan says", self._count, partial(self._write, "TRIG:COUN"))
        scan = "ROUT:SCAN"
        meet(scan, self._list, partial(self._has, scan), partial(self._write, scan))
        for sensor in self._sensors.values():
            at = f"(@{sensor.channel})"
            meet(f"CONF {at}", "FRES", partial(self._configured, at), partial(self._configure, at))

    def _has(self, header: str) -> str:
        answer = self._line.query(f"{header}?").strip()
        whole = LIST.fullmatch(answer)
        return whole[1] if whole else answer

    def _write(self, header: str, value: str) -> None:
        self._line.command(f"ABOR;:{header} {value}")

    def _count(self) -> str:
        count = self._line.number("TRIG:COUN?")
        return "INF" if count > ENDLESS else f"{count:.0f}"

    def _configured(self, at: str) -> str:
        """Return a channel's function, range and resolution, as `CONF:` takes them."""
        return self._line.query(f"CONF? {at}").strip().strip('"')

    def _configure(self, at: str, configured: str) -> None:
        self._line.command(f"ABOR;:CONF:{configured},{at}")

    def _initiate(self, readings: int) -> None:
        # ABOR: where the answer to an INIT was lost, it scans already and would refuse another.
        self._line.command(f"ABOR;:TRIG:COUN {readings};:INIT")

    def _looked(self) -> tuple[bool, int]:
        condition, points = self._line.answers({"STAT:OPER:COND?": int, "DATA:POIN?": int})
        return bool(condition & STILL_AT_IT), points // self.inputs

    def _read_out(self, readings: int) -> NDArray[np.float64]:
        """Return resistances in ohm, shape (readings, places), the device's first."""
        answer = self._line.query("FETC?")
        values = self._readings("FETC?", answer, 2 * readings * self.inputs).reshape(-1, 2)
        by_channel: dict[int, list[float]] = {
            sensor.channel: [] for sensor in self._sensors.values()
        }
        for ohms, channel in values.tolist():
            by_channel.setdefault(int(channel), []).append(ohms)
        rows = list(by_channel.values())
        if len(rows) != self.inputs or any(len(row) != readings for row in rows):
            raise self._line.odd("FETC?", answer)
        return np.array(rows).T

    def _last(self) -> float | None:
        """Return the last reading of the device, None before there is one."""
        if self._looked()[1] == 0:
            return None
        question = f"DATA:LAST? (@{self._sensors[DEVICE].channel})"
        value = float(self._numbers(question, self._line.query(question))[0])
        return None if abs(value) >= NO_READING * 0.9999 else value


def sensor_of(given: int | Sensor) -> Sensor:
    """Return a place's sensor: a usual Pt100 where its channel alone is given."""
    return given if isinstance(given, Sensor) else Sensor(channel=given)


def _columns(sensors: Mapping[str, Sensor]) -> list[tuple[str, str]]:
    columns = []
    for place, sensor in sensors.items():
        resistance, temperature = place_columns(place)
        at = f"at {place}, channel {sensor.channel}"
        columns.append((resistance, f"ohm, four-wire resistance of the Pt100 {at}"))
        columns.append((temperature, f"degC, by IEC 60751 from the resistance {at}"))
    return columns
