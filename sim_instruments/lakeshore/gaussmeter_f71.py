"""Lake Shore F71 teslameter with a three-axis probe, SCPI over TCP.

From the F71 manual and the maker's public client: LF ends a command, CR LF a reply, an empty line
produces nothing, averaging counts samples of 10 ms, the buffer is emptied by reading, `FETCh` with
or without FIELd. Assumed, since no source at hand says it: readings are block averages stamped at
the END of their window, `FETCh:DC? ALL` gives magnitude, x, y, z in the order of the buffer, the
buffer holds 1000 records and loses the oldest, an overloaded axis reads 9.9E37, ranges are 35 mT,
350 mT and 3.5 T, which settings outlast `*RST`: none. What of a field has no meaning in DC mode,
its rms and its frequency, is refused with -221 there, as its DC value is in the other modes. In AC
mode (0.1 to 500 Hz) the rms is that of the last 10 s about their mean, and the frequency that of
the axis which alternates most, 0 where there is nothing but noise; in HIFR mode (50 Hz to 100 kHz)
the worlds have nothing that fast, and noise is read. The window is assumed.
"""

from __future__ import annotations

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
    number,
    single_parameter,
    whole_number,
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
KEPT: KeptTable = {"SENSe:TCOMpensation:TSOURce": (word("PROBE", "MTEMP", "NONE"), "PROBE")}
EPOCH = datetime(2026, 1, 1, tzinfo=UTC)


EVERY = 4
FETCHED = {"": 0, "MAGNITUDE": 0, "MAG": 0, "X": 1, "Y": 2, "Z": 3, "ALL": EVERY}
ALTERNATES_S, SAMPLE_S = 10.0, 1e-3
NOTHING_BUT_NOISE = 3.0
"""Below so many times the noise, no frequency is given."""


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
        self._least_T, self._largest_T = np.inf, -np.inf
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
                "FETCh[:FIELd]:FREQuency?": lambda: f"{self._frequency_Hz():.6E}",
                "FETCh[:FIELd]:MAXimum?": lambda: self._shown(self._largest_T),
                "FETCh[:FIELd]:MINimum?": lambda: self._shown(self._least_T),
                "FETCh:BUFFer:DC?": self._read_buffer,
                "FETCh:TEMPerature?": lambda: f"{self._probe_degC:.3f}",
                "SENSe:MRESet": self._forget_extremes,
                "SENSe:RELative:TARE": self._take_tare,
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

    def _alternating(self) -> tuple[Array, float]:
        """Return what alternates about its mean, shape (samples, 3) in T, and the noise in T."""
        if self._mode == "DC":
            raise ScpiError(-221)
        end_s = self._clock.now()
        begin_s = max(end_s - ALTERNATES_S, 0.0)
        count = max(round((end_s - begin_s) / SAMPLE_S), 1)
        noise_T = 1e-3 * self._noise_mT * np.sqrt(TICK_S / SAMPLE_S)
        noisy_T = noise_T * self._rng.standard_normal((count, 3))
        if self._mode == "HIFR" or end_s - begin_s < SAMPLE_S:
            return noisy_T, noise_T
        edges_s = np.linspace(begin_s, end_s, count + 1)
        field_mT = self._world.mean_probe_field_mT(edges_s) @ self._rotation.T
        field_T = field_mT * self._gain * 1e-3 + noisy_T
        return field_T - field_T.mean(axis=0), noise_T

    def _rms(self, parameters: list[str]) -> str:
        wanted = fetched(parameters)
        field_T, _ = self._alternating()
        axes_T = np.sqrt((field_T**2).mean(axis=0))
        values = np.array([np.linalg.norm(axes_T), *axes_T]) / self._unit_T
        return self._answered(values, wanted)

    def _frequency_Hz(self) -> float:
        field_T, noise_T = self._alternating()
        axes_T = np.sqrt((field_T**2).mean(axis=0))
        axis = int(axes_T.argmax())
        if axes_T[axis] < NOTHING_BUT_NOISE * noise_T or len(field_T) < 2:
            return 0.0
        # Where it goes through zero upwards, having been well below it since the last time.
        well = np.where(np.abs(field_T[:, axis]) > axes_T[axis] / 2, np.sign(field_T[:, axis]), 0)
        sides = well[well != 0]
        at = np.flatnonzero(well != 0)[1:][(sides[1:] > 0) & (sides[:-1] < 0)]
        return (len(at) - 1) / (SAMPLE_S * float(at[-1] - at[0])) if len(at) > 1 else 0.0

    def _magnitude_T(self) -> float:
        self._collect()
        return float(np.linalg.norm(self._last_T))

    def _forget_extremes(self) -> None:
        self._least_T = self._largest_T = self._magnitude_T()

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
        wanted = fetched(parameters)
        if self._mode != "DC":
            raise ScpiError(-221)
        self._collect()
        values = self._in_unit(self._last_T[None, :])[0]
        if relative:
            values = values - self._tare_T / self._unit_T
        return self._answered(values, wanted)

    def _answered(self, values: Array, wanted: int) -> str:
        """Return what is wanted of magnitude, x, y and z, in the order of this firmware."""
        if wanted == EVERY and self._last_first:
            values = np.roll(values, -1)
        shown = values if wanted == EVERY else values[wanted : wanted + 1]
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
        self._buffer.append(FinishedReadings(ticks[1:], field_T))
        while sum(part.ticks.size for part in self._buffer[1:]) >= BUFFER_RECORDS:
            self._buffer.pop(0)


def fetched(parameters: list[str]) -> int:
    """Return which of magnitude, x, y, z or all of them is fetched; ScpiError -224 for others."""
    wanted = single_parameter(parameters).upper() if parameters else ""
    if wanted not in FETCHED:
        raise ScpiError(-224)
    return FETCHED[wanted]
