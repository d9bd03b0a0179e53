"""The commands about a vapour cell: fields of its coils by a signal generator, pump light, heat.

Here, and nowhere else, a field at the cell becomes a voltage.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from station.errors import InstrumentError
from station.method.set_points import Bounded, Bounds, Command, Station
from station.units import UnitError, parse_as

if TYPE_CHECKING:
    from station.instruments.bench import Bench

GRADIENT = "gradient"
SURE_OF_DARK = 1.3
"""The field comes when the light has been off for a third of the shutter's delay again."""


def constant_of(coil: str) -> tuple[str, str]:
    """Return the bench file's key of what a volt makes at a coil, and its unit."""
    return ("gradient_at_1_V", "nT/cm") if coil == GRADIENT else (f"constant_{coil}", "nT/V")


def coil_voltage_V(bench: Bench, generator: str, coil: str, size: float) -> float:
    """Return the voltage for a field in nT, or a gradient in nT/cm; NaN without a coil constant."""
    key, unit = constant_of(coil)
    try:
        constant = parse_as(str(bench.instruments[generator].settings[key]), unit)
    except (KeyError, UnitError):
        return math.nan
    return size / constant if math.isfinite(constant) and constant > 0.0 else math.nan


def dark_after_s(station: Station, shutter: str) -> float:
    """Return the time from the trigger until the light is surely off.

    Raises InstrumentError where nobody has measured how long the shutter takes.
    """
    from station.roles import PumpLaser

    dark_s = getattr(station.role(shutter, PumpLaser), "trigger_to_dark_s", None)
    if dark_s is None:
        raise InstrumentError(
            shutter,
            "fire a shot",
            "its time from trigger to dark is not known",
            "measure it with a photodiode and write settings.trigger_to_dark in the bench file",
        )
    return SURE_OF_DARK * float(dark_s)


@dataclass(frozen=True)
class CellField(Command[None]):
    """A steady field at a coil of a cell: in nT, or in nT/cm of the gradient coil."""

    channel: int
    coil: str
    size: float
    purpose: str = ""

    def voltage_V(self, bench: Bench) -> float:
        """Return the voltage."""
        return coil_voltage_V(bench, self.instrument, self.coil, self.size)

    def words(self, bench: Bench) -> str:
        """Return channel, coil, field and voltage."""
        unit = "nT/cm" if self.coil == GRADIENT else "nT"
        size = f"{self.purpose}{self.size:g} {unit}"
        voltage_V = self.voltage_V(bench)
        return f"channel {self.channel}, coil {self.coil}, {size}, {voltage_V:.4g} V"

    def bounds(self, bench: Bench) -> Bounds:
        """Return the voltage in magnitude; nothing where the coil has no constant."""
        if math.isnan(coil_voltage_V(bench, self.instrument, self.coil, 1.0)):
            return {}
        return {"voltage_V": abs(self.voltage_V(bench))}

    def apply(self, station: Station, prepared: None) -> None:
        """Put the voltage on the channel, at once."""
        from station.roles import SignalGenerator

        generator = station.role(self.instrument, SignalGenerator)
        generator.hold(self.channel, self.voltage_V(station.bench))


@dataclass(frozen=True)
class TriggeredCellField(CellField):
    """A field that is added at the next trigger, once the light behind `shutter` is off.

    It lasts for `record_s` and twice what the shutter takes.
    """

    record_s: float = field(kw_only=True)
    shutter: str = field(kw_only=True)

    def apply(self, station: Station, prepared: None) -> None:
        """Arm the step."""
        from station.roles import SignalGenerator

        delay_s = dark_after_s(station, self.shutter)
        generator = station.role(self.instrument, SignalGenerator)
        voltage_V = self.voltage_V(station.bench)
        generator.prepare_step(self.channel, voltage_V, self.record_s + 2 * delay_s, delay_s)


@dataclass(frozen=True)
class CellTone(CellField):
    """A square tone at a coil from the next trigger on, beginning with its rise.

    It goes up by `size` from what the coil holds, and back; each level lasts for `half_s`.
    """

    half_s: float = field(kw_only=True)
    cycles: int = field(kw_only=True)

    def words(self, bench: Bench) -> str:
        """Return channel, coil, amplitude, frequency and the voltage from peak to peak."""
        return (
            f"channel {self.channel}, coil {self.coil}, {self.purpose}{self.size / 2:g} nT at "
            f"{0.5 / self.half_s:g} Hz, {self.voltage_V(bench):.4g} Vpp"
        )

    def apply(self, station: Station, prepared: None) -> None:
        """Arm the tone."""
        from station.roles import SignalGenerator

        generator = station.role(self.instrument, SignalGenerator)
        voltage_V = self.voltage_V(station.bench)
        generator.prepare_step(self.channel, voltage_V, self.half_s, cycles=self.cycles)


@dataclass(frozen=True)
class NulledCellFields(Bounded):
    """Fields at coils that are solved from data, and the shots that look for them.

    `coils` names them, `largest_nT` is the most of any.
    """

    coils: str
    largest_nT: float

    def bounds(self, bench: Bench) -> Bounds:
        """Return the largest voltage of a coil."""
        voltages_V = [
            coil_voltage_V(bench, self.instrument, coil, self.largest_nT) for coil in self.coils
        ]
        return {} if math.isnan(sum(voltages_V)) else {"voltage_V": max(voltages_V)}


@dataclass(frozen=True)
class PumpLight(Command[None]):
    """The pump light: through until the trigger, or whatever it does (`steady`), or blocked."""

    through: bool
    steady: bool = False

    def words(self, bench: Bench) -> str:
        """Return which of both."""
        if not self.through:
            return "closed"
        return "open all the time" if self.steady else "open until the trigger"

    def apply(self, station: Station, prepared: None) -> None:
        """Set the shutter."""
        from station.roles import PumpLaser

        pump = station.role(self.instrument, PumpLaser)
        if not self.through:
            pump.close_shutter()
        elif self.steady:
            pump.open_shutter()
        else:
            pump.follow_trigger()


@dataclass(frozen=True)
class CellHeat(Command[None]):
    """A vapour cell's heater on, its set-point on a ramp from the present temperature."""

    temperature_degC: float
    rate_degC_per_min: float

    def words(self, bench: Bench) -> str:
        """Return where it goes, and how fast."""
        return f"heat to {self.temperature_degC:g} degC at {self.rate_degC_per_min:g} degC/min"

    def bounds(self, bench: Bench) -> Bounds:
        """Return temperature and slope."""
        return {
            "temperature_degC": self.temperature_degC,
            "temperature_slew_degC_per_min": self.rate_degC_per_min,
        }

    def apply(self, station: Station, prepared: None) -> None:
        """Switch it on where it stands, and begin the ramp."""
        from station.roles import CellHeater

        heater = station.role(self.instrument, CellHeater)
        heater.switch_on()
        heater.ramp_to(self.temperature_degC, self.rate_degC_per_min)
