"""Lake Shore F71 teslameter with a three-axis probe, SCPI over TCP.

From the F71 manual and the maker's public client: LF ends a command, CR LF a reply, an empty line
produces nothing, averaging counts samples of 10 ms, the buffer is emptied by reading, `FETCh` with
or without FIELd. Assumed, since no source at hand says it: readings are block averages stamped at
the END of their window, `FETCh:DC? ALL` gives magnitude, x, y, z in the order of the buffer, the
buffer holds 1000 records and loses the oldest, an overloaded axis reads 9.9E37, ranges are 35 mT,
350 mT and 3.5 T, which settings outlast `*RST`: none. What of a field has no meaning in DC mode,
its rms and its frequency, is refused with -221 there, as DC readings are in the modes AC and HIFR.
By the maker's client alone: filters (of HIFR readings), qualifier, relative baseline, peaks, analog
output and field control, at which nothing hangs here. Assumed of these: rms and frequency are those
of the last 10 s (AC, from 0.1 Hz, sampled at 1 kHz) or 0.2 s (HIFR, at 20 kHz) without their mean,
the frequency 0 where nothing but noise is there; filters are of first order; peaks are the largest
and least reading of an axis since MRESet; a baseline is that of each axis and of the magnitude,
which the qualifier is held against; ranges of numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from sim_instruments.faults.lasting import Frozen, Overload
from sim_instruments.instrument import Setting
from sim_instruments.wire.scpi import (
    ScpiError,
    boolean,
    choice,
    none,
    number,
    number_or,
    single_parameter,
    whole_number,
    within,
    word,
    words,
)
from sim_instruments.wire.scpi_device import KeptSettings, KeptTable, Listed, ScpiDevice, taken
from sim_instruments.world.coils import AXES, small_rotation, wiring
from sim_instruments.world.piecewise import Array

FIRMWARE = "1.6.2019092002"
TICK_S = 0.01
TICKS_PER_S = 100
BUFFER_RECORDS = 1000
RANGES_T = (0.035, 0.35, 3.5)
MAX_AVERAGED = 1000
OVERLOAD_READING = 9.9e37
OVERLOAD_BIT = 2
CUTOFFS = {"NONE": 0.0, **{f"F{Hz}": float(Hz) for Hz in (10, 30, 100, 300, 1000, 3000, 10000)}}
PASSES = "LPASS", "HPASS", "BPASS"
QUALIFIES: Mapping[str, Callable[[float, float, float], bool]] = {
    "OVER": lambda field, low, high: field > low,
    "UNDER": lambda field, low, high: field < low,
    "BETWEEN": lambda field, low, high: low <= field <= high,
    "OUTSIDE": lambda field, low, high: not low <= field <= high,
    "ABSBETWEEN": lambda field, low, high: low <= abs(field) <= high,
    "ABSOUTSIDE": lambda field, low, high: not low <= abs(field) <= high,
}
"""Whether the qualifier's condition is met, by its mode."""
WINDOWS = {"AC": (10.0, 1e-3), "HIFR": (0.2, 5e-5)}
"""What rms and frequency are worked out of, and the time from sample to sample, in s."""
NOTHING_BUT_NOISE = 6.0
"""Of the largest line over the median one: white noise has up to about 4."""


def cutoff(text: str) -> float:
    """Return a corner frequency in Hz, given by its name or as a number."""
    value = number_or(text, CUTOFFS)
    if value not in CUTOFFS.values():
        raise ScpiError(-222)
    return value


KEPT: KeptTable = {
    "SENSe:TCOMpensation:TSOURce": (word("PROBE", "MTEMP", "NONE"), "PROBE"),
    "SENSe:TCOMpensation:MTEMperature": (within(-273.15, 1000.0, 25.0), 25.0),
    "SENSe:FILTer[:STATe]": (boolean, 0),
    "SENSe:FILTer:TYPE": (word(*PASSES), "LPASS"),
    "SENSe:FILTer:LPASs:CUToff": (cutoff, 0.0),
    "SENSe:FILTer:HPASs:CUToff": (cutoff, 0.0),
    "SENSe:FILTer:BPASs:CENTer": (within(10.0, 100e3, 1000.0), 1000.0),
    "SENSe:QUALifier[:STATe]": (boolean, 0),
    "SENSe:QUALifier:LATCh": (boolean, 0),
    "SOURce:AOUT": (
        word("OFF", "XRAW", "YRAW", "ZRAW", "XCOR", "YCOR", "ZCOR", "MCOR"),
        "OFF",
    ),
    "SOURce:AOUT:SFACtor": (number, 1.0),
    "SOURce:AOUT:BASeline": (number, 0.0),
    "SOURce:FIELd:VLIMit": (within(0.0, 10.0, 10.0), 10.0),
    "SOURce:FIELd:SLEW": (within(0.0, 1000.0, 10.0), 10.0),
    "SOURce:FIELd:MODE": (word("CLLOOP", "OPLOOP"), "CLLOOP"),
    "SOURce:FIELd:STATe": (boolean, 0),
    "SOURce:FIELd:CLLoop:GAIN": (within(0.0, 1e9, 0.0), 0.0),
    "SOURce:FIELd:CLLoop:INTegral": (within(0.0, 1e9, 0.0), 0.0),
    "SOURce:FIELd:CLLoop:RAMPrate": (within(0.0, 1e9, 0.0), 0.0),
    "SOURce:FIELd:CLLoop:SETPoint": (number, 0.0),
    "SOURce:FIELd:OPLoop:VOLTage": (within(-10.0, 10.0, 0.0), 0.0),
}
EPOCH = datetime(2026, 1, 1, tzinfo=UTC)


class FinishedReadings(NamedTuple):
    """Finished readings: the instrument's tick at the end of each, and x y z in T."""

    ticks: npt.NDArray[np.int64]
    field_T: Array


class LakeshoreF71(ScpiDevice):
    """The teslameter at the probe's place in the simulated world.

    Truth (`simulator` mapping): `noise_per_sample` (rms of one 10 ms sample of one axis),
    `gain_error` and `zero_offset` (x, y, z), `rotation` (about_x, about_y, about_z of the probe in
    the coil frame), `clock_offset` and `clock_error` of its own clock, `probe_temperature`. May be
    given: `all_order`, magnitude-first or magnitude-last, of `FETCh:DC? ALL`; `field_unit`, TESLA
    or GAUSS, as somebody left it; `wiring`, which axis of the probe an axis shows, such as
    `{x: y, y: -x}`, each its own without it.
    """

    model = "Lake Shore F71"

    reply_end = b"\r\n"
    lasting_faults: ClassVar = (Frozen.kind, Overload.kind)

    def __init__(self, setting: Setting) -> None:
        super().__init__(f"Lake Shore,F71,{setting.serial},{FIRMWARE}")
        truth = setting.truth
        self._world, self._clock, self._rng = setting.world, setting.clock, setting.rng
        self._noise_mT = truth.quantity("noise_per_sample", "mT")
        self._gain = 1.0 + np.array(truth.quantities("gain_error", AXES, "1"))
        self._zero_mT = np.array(truth.quantities("zero_offset", AXES, "mT"))
        self._rotation = wiring(truth) @ small_rotation(truth, "rotation")
        self._clock_offset_s = truth.quantity("clock_offset", "s")
        self._clock_rate = 1.0 + truth.quantity("clock_error", "1")
        self._probe_degC = truth.quantity("probe_temperature", "degC")
        self._faults = setting.faults
        self._probe_serial = f"{setting.serial}-P"
        self._last_first = truth.text("all_order", "magnitude-first") == "magnitude-last"
        self._kept = KeptSettings(KEPT)
        self._restore_defaults()
        self._set_unit(truth.text("field_unit", "TESLA"))
        self._add_all()
        self.begin_to_serve(setting)

    def operation_condition(self) -> int:
        """Return bit 1 while the last reading was overloaded."""
        self._collect()
        return OVERLOAD_BIT if (np.abs(self._last_T) >= OVERLOAD_READING).any() else 0

    def reset(self) -> None:
        """Go to DC mode, autorange, averaging of 20 samples, Tesla."""
        self._restore_defaults()

    def _restore_defaults(self) -> None:
        self._mode, self._unit_T = "DC", 1.0
        self._autorange, self._range_T = True, RANGES_T[0]
        self._averaged = 20
        self._last_T = np.zeros(3)
        self._tare_T = np.zeros(4)
        self._kept.reset()
        self._threshold: tuple[str, list[float]] = "OVER", [0.0]
        self._latched = False
        self._least_T, self._largest_T = np.inf, -np.inf
        self._lowest_T, self._highest_T = np.inf, -np.inf
        self._buffer: list[FinishedReadings] = []
        self._next_tick = self._tick_now() - self._averaged
        self._collect()
        self._buffer = []

    def _add_all(self) -> None:
        self.add_commands(self._kept.commands())
        self.add_commands(
            {
                "SENSe:MODE": taken(self, "_mode", self._set_mode),
                "SENSe:AVERage:COUNt": taken(self, "_averaged", self._set_averaging),
                "SENSe:RANGe[:UPPer]": (self._set_range, lambda: f"{self._range_T:.6E}"),
                "SENSe:RANGe:AUTO": taken(self, "_autorange", self._set_autorange),
                "UNIT:FIELd": (
                    self._set_unit,
                    lambda: "TESLA" if self._unit_T == 1.0 else "GAUSS",
                ),
                "FETCh[:FIELd]:DC": Listed(None, self._fetch),
                "FETCh[:SCALar]:DC": Listed(None, self._fetch),
                "FETCh[:FIELd]:RELative": Listed(None, partial(self._fetch, relative=True)),
                # Of an alternating field alone.
                "FETCh[:FIELd]:RMS": Listed(None, self._rms),
                "FETCh[:FIELd]:FREQuency?": lambda: f"{self._alternating()[1]:+.7E}",
                "FETCh[:FIELd]:MAXPeak?": lambda: self._shown(self._highest_T),
                "FETCh[:FIELd]:MINPeak?": lambda: self._shown(self._lowest_T),
                "FETCh[:FIELd]:MAXimum?": lambda: self._shown(self._largest_T),
                "FETCh[:FIELd]:MINimum?": lambda: self._shown(self._least_T),
                "FETCh:BUFFer:DC?": self._read_buffer,
                "FETCh:TEMPerature?": lambda: f"{self._probe_degC:.3f}",
                "SENSe:MRESet": self._forget_extremes,
                "SENSe:RELative:TARE": self._take_tare,
                "SENSe:RELative:BASeline": (
                    self._set_baseline,
                    lambda: f"{self._tare_T[0] / self._unit_T:+.7E}",
                ),
                "SENSe:QUALifier:CONDition?": lambda: int(self._qualified()),
                "SENSe:QUALifier:LRESet": self._reset_latch,
                "SENSe:QUALifier:THReshold": Listed(self._set_threshold, self._shown_threshold),
                "SYSTem:ERRor:CLEar": self.errors.clear,
                # What the memory of the probe says of it.
                "PROBe:MODel?": lambda: '"FP-2X-250-ZS15M-6"',
                "PROBe:SNUMber?": lambda: f'"{self._probe_serial}"',
                "PROBe:PTYPe?": lambda: '"THREE"',
                "PROBe:STYPe?": lambda: '"FIELDPROBE"',
                "PROBe:SOR?": lambda: '"ASYMMETRIC"',
                "PROBe:AXES?": lambda: "3",
                "PROBe:CALDate?": lambda: '"2026-01-15"',
            }
        )

    def _rms(self, parameters: list[str]) -> str:
        rms_T, _ = self._alternating()
        return self._selected(parameters, rms_T[None, :])

    def _alternating(self) -> tuple[Array, float]:
        """Return the rms of each axis in T and the frequency of the largest in Hz."""
        if self._mode not in WINDOWS:
            raise ScpiError(-221)
        window_s, step_s = WINDOWS[self._mode]
        end_s = self._clock.now()
        count = max(round(min(window_s, end_s) / step_s), 2)
        edges_s: Array = end_s - step_s * np.arange(count, -1, -1, dtype=float)
        field_mT = self._world.mean_probe_field_mT(edges_s) @ self._rotation.T
        noise_mT = self._noise_mT * np.sqrt(TICK_S / step_s)
        field_mT = field_mT + noise_mT * self._rng.standard_normal(field_mT.shape)
        lines_mT = np.fft.rfft(field_mT * self._gain, axis=0) / len(field_mT)
        lines_mT[0] = 0.0
        frequencies_Hz = np.asarray(np.fft.rfftfreq(len(field_mT), step_s), dtype=np.float64)
        lines_mT = lines_mT * self._passed(frequencies_Hz)[:, None]
        rms_mT = np.sqrt(2.0 * (np.abs(lines_mT) ** 2).sum(axis=0))
        largest = np.abs(lines_mT[:, int(rms_mT.argmax())])
        is_noise = largest.max() < NOTHING_BUT_NOISE * np.median(largest)
        frequency_Hz = 0.0 if is_noise else float(frequencies_Hz[int(largest.argmax())])
        return rms_mT * 1e-3, frequency_Hz

    def _passed(self, frequencies_Hz: Array) -> Array:
        """Return what the filter lets through of each frequency above zero."""
        values = self._kept.values
        kind = str(values["SENSe:FILTer:TYPE"])
        of_kind = {
            "LPASS": "SENSe:FILTer:LPASs:CUToff",
            "HPASS": "SENSe:FILTer:HPASs:CUToff",
            "BPASS": "SENSe:FILTer:BPASs:CENTer",
        }
        corner_Hz = float(values[of_kind[kind]])
        if self._mode != "HIFR" or not values["SENSe:FILTer[:STATe]"] or corner_Hz == 0.0:
            return np.ones_like(frequencies_Hz)
        ratio = np.maximum(frequencies_Hz, 1e-9) / corner_Hz
        off = {"LPASS": ratio, "HPASS": 1.0 / ratio, "BPASS": ratio - 1.0 / ratio}[kind]
        return 1.0 / np.sqrt(1.0 + off**2)

    def _set_baseline(self, text: str) -> None:
        self._tare_T = np.full(4, number(text) * self._unit_T)

    def _set_threshold(self, parameters: list[str]) -> None:
        mode = choice(parameters[0] if parameters else "", words(*QUALIFIES))
        wanted = 1 if mode in {"OVER", "UNDER"} else 2
        if len(parameters) != 1 + wanted:
            raise ScpiError(-109 if len(parameters) <= wanted else -108)
        self._threshold = mode, [number(text) * self._unit_T for text in parameters[1:]]

    def _shown_threshold(self, parameters: list[str]) -> str:
        none(parameters)
        mode, fields_T = self._threshold
        return ",".join([mode, *(f"{field_T / self._unit_T:+.7E}" for field_T in fields_T)])

    def _qualified(self) -> bool:
        """Return whether the qualifier is on and its condition is met, or was where it latches."""
        values = self._kept.values
        mode, fields_T = self._threshold
        is_met = QUALIFIES[mode](self._magnitude_T(), fields_T[0], fields_T[-1])
        is_met = bool(values["SENSe:QUALifier[:STATe]"]) and bool(is_met)
        self._latched = bool(values["SENSe:QUALifier:LATCh"]) and (is_met or self._latched)
        return is_met or self._latched

    def _reset_latch(self) -> None:
        self._latched = False

    def _magnitude_T(self) -> float:
        self._collect()
        return float(np.linalg.norm(self._last_T))

    def _forget_extremes(self) -> None:
        self._least_T = self._largest_T = self._magnitude_T()
        self._lowest_T, self._highest_T = float(self._last_T.min()), float(self._last_T.max())

    def _take_tare(self) -> None:
        magnitude_T = self._magnitude_T()
        self._tare_T = np.array([magnitude_T, *self._last_T])

    def _shown(self, extreme_T: float) -> str:
        self._collect()
        return f"{(extreme_T if np.isfinite(extreme_T) else 0.0) / self._unit_T:+.7E}"

    def _set_mode(self, text: str) -> None:
        self._begin_anew("_mode", choice(text, words("DC", "AC", "HIFR")))

    def _set_averaging(self, text: str) -> None:
        self._begin_anew("_averaged", whole_number(text, 1, MAX_AVERAGED))

    def _begin_anew(self, name: str, value: object) -> None:
        self._collect()
        setattr(self, name, value)
        self._next_tick = self._tick_now()

    def _set_range(self, text: str) -> None:
        wanted = number(text)
        fitting = [each for each in RANGES_T if abs(wanted) <= each * (1 + 1e-9)]
        if not fitting:
            raise ScpiError(-222)
        self._collect()
        self._range_T, self._autorange = fitting[0], False

    def _set_autorange(self, text: str) -> None:
        on = boolean(text)
        self._collect()
        self._autorange = on

    def _set_unit(self, text: str) -> None:
        unit = choice(text, {"TESLA": "T", "T": "T", "GAUSS": "G", "G": "G"})
        self._unit_T = 1.0 if unit == "T" else 1e-4

    def _fetch(self, parameters: list[str], *, relative: bool = False) -> str:
        if self._mode != "DC":
            raise ScpiError(-221)
        self._collect()
        return self._selected(parameters, self._last_T[None, :], relative=relative)

    def _selected(self, parameters: list[str], field_T: Array, *, relative: bool = False) -> str:
        names = {"": 0, "MAGNITUDE": 0, "MAG": 0, "X": 1, "Y": 2, "Z": 3, "ALL": 4}
        wanted = single_parameter(parameters).upper() if parameters else ""
        if wanted not in names:
            raise ScpiError(-224)
        values = self._in_unit(field_T)[0]
        if relative:
            values = values - self._tare_T / self._unit_T
        if names[wanted] == 4 and self._last_first:
            values = np.roll(values, -1)
        shown = values if names[wanted] == 4 else values[names[wanted] : names[wanted] + 1]
        return ",".join(f"{value:+.7E}" for value in shown)

    def _read_buffer(self) -> str:
        self._collect()
        buffer, self._buffer = self._buffer, []
        if not buffer:
            return '""'
        ticks = np.concatenate([part.ticks for part in buffer])[-BUFFER_RECORDS:]
        field_T = np.concatenate([part.field_T for part in buffer])[-BUFFER_RECORDS:]
        states = np.where((np.abs(field_T) >= OVERLOAD_READING).any(axis=1), OVERLOAD_BIT, 0)
        records = [
            f"{self._stamp(tick)},{m:+.7E},{x:+.7E},{y:+.7E},{z:+.7E},{state};"
            for tick, (m, x, y, z), state in zip(
                ticks.tolist(), self._in_unit(field_T).tolist(), states.tolist(), strict=True
            )
        ]
        return f'"{"".join(records)}"'

    @staticmethod
    def _stamp(tick: int) -> str:
        moment = EPOCH + timedelta(milliseconds=tick * 10)
        return moment.strftime("%Y-%m-%dT%H:%M:%S.") + f"{moment.microsecond // 1000:03d}+00:00"

    def _in_unit(self, field_T: Array) -> Array:
        overload = np.abs(field_T) >= OVERLOAD_READING
        magnitude = np.where(
            overload.any(axis=1),
            OVERLOAD_READING,
            np.linalg.norm(np.where(overload, 0.0, field_T), axis=1),
        )
        rows = np.column_stack([magnitude, field_T])
        return np.where(rows >= OVERLOAD_READING, OVERLOAD_READING, rows / self._unit_T)

    def _tick_now(self) -> int:
        now_s = (self._clock.now() + self._clock_offset_s) * self._clock_rate
        # A window that ends at this very moment is finished, whatever the last bit says.
        return int(np.floor(now_s * TICKS_PER_S + 1e-6))

    def _collect(self) -> None:
        """Finish all averaging windows that have ended; the last reading and the buffer follow."""
        count = (self._tick_now() - self._next_tick) // self._averaged
        if count <= 0:
            return
        first = self._next_tick + max(count - BUFFER_RECORDS, 0) * self._averaged
        self._next_tick += count * self._averaged
        if self._mode != "DC":
            return
        count = min(count, BUFFER_RECORDS)
        ticks = first + self._averaged * np.arange(count + 1)
        edges_s = ticks.astype(np.float64) * TICK_S / self._clock_rate - self._clock_offset_s
        field_mT = self._world.mean_probe_field_mT(edges_s) @ self._rotation.T
        noise_mT = self._noise_mT / np.sqrt(self._averaged) * self._rng.standard_normal((count, 3))
        field_T = (field_mT * self._gain + self._zero_mT + noise_mT) * 1e-3
        if self._autorange:
            largest = float(np.abs(field_T[-1]).max())
            self._range_T = next((each for each in RANGES_T if largest <= each), RANGES_T[-1])
            limit_T = RANGES_T[-1]
        else:
            limit_T = self._range_T
        beyond = self._faults.during(Overload.kind, edges_s[1:])[:, None]
        field_T = np.where((np.abs(field_T) > limit_T) | beyond, OVERLOAD_READING, field_T)
        for k in np.flatnonzero(self._faults.during(Frozen.kind, edges_s[1:])).tolist():
            field_T[k] = field_T[k - 1] if k else self._last_T
        self._last_T = field_T[-1]
        shown_T = field_T[(np.abs(field_T) < OVERLOAD_READING).all(axis=1)]
        if shown_T.size:
            magnitudes_T = np.linalg.norm(shown_T, axis=1)
            self._least_T = min(self._least_T, float(magnitudes_T.min()))
            self._largest_T = max(self._largest_T, float(magnitudes_T.max()))
            self._lowest_T = min(self._lowest_T, float(shown_T.min()))
            self._highest_T = max(self._highest_T, float(shown_T.max()))
        self._buffer.append(FinishedReadings(ticks[1:], field_T))
        while sum(part.ticks.size for part in self._buffer[1:]) >= BUFFER_RECORDS:
            self._buffer.pop(0)
