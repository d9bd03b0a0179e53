"""The cell on the bench: its coils by generator and channel, its light, and one shot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from station.errors import InstrumentError

from .parameters import SerfParameters
from .shots import Wanted

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.roles import Block
    from station.runner.run import Run

    from .dataset import Shot
    from .tone import ToneFit

GENERATOR_XY = "signal_generator.xy"
GENERATOR_Z = "signal_generator.z_gradient"
DIGITIZER = "digitizer"
PUMP = "pump_laser"
CHANNELS: Mapping[str, tuple[str, int]] = {
    "x": (GENERATOR_XY, 1),
    "y": (GENERATOR_XY, 2),
    "z": (GENERATOR_Z, 1),
    "gradient": (GENERATOR_Z, 2),
}
"""The generator and the channel at each coil, as the names of the instances say."""

LOOK_S = 0.02
SURE_OF_DARK = 1.3
"""The field comes when the light has been off for a third of the shutter's delay again."""
LONGEST_WAIT_S = 10.0


class LightPassed(InstrumentError):
    """The pump light was not blocked during a shot."""


@dataclass(frozen=True)
class Coils:
    """What a volt makes at each coil: nT for x, y, z, and nT/cm for the gradient."""

    nT_per_V: Mapping[str, float]

    def voltage_V(self, coil: str, field_nT: float) -> float:
        """Return the voltage for a field (or a gradient in nT/cm)."""
        return field_nT / self.nT_per_V[coil]


def coils_of(bench: Bench) -> Coils:
    """Return the coil constants of the bench file: `constant_x` … nT/V, `gradient_at_1_V` nT/cm."""
    from station.units import parse_as

    found = {}
    for coil, (generator, _) in CHANNELS.items():
        settings = bench.instruments[generator].settings
        if coil == "gradient":
            found[coil] = parse_as(str(settings["gradient_at_1_V"]), "nT/cm")
        else:
            found[coil] = parse_as(str(settings[f"constant_{coil}"]), "nT/V")
    return Coils(found)


class Cell:
    """The instruments about the cell, as one run uses them."""

    def __init__(self, run: Run) -> None:
        from station.roles import Digitizer, PumpLaser, SignalGenerator

        self.run = run
        self.parameters: SerfParameters = run.parameters
        self.coils = coils_of(run.bench)
        self.generators = {
            name: run.role(name, SignalGenerator) for name in (GENERATOR_XY, GENERATOR_Z)
        }
        self.digitizer = run.role(DIGITIZER, Digitizer)
        self.pump = run.role(PUMP, PumpLaser)
        self.held_nT = dict.fromkeys("xyz", 0.0)
        self.usual: list[ToneFit] = []
        """The fits of good shots that were taken last."""

    def prepare(self) -> None:
        """Write the limits, hold every coil at zero and let the light through until the trigger."""
        for generator in self.generators.values():
            generator.programme_limits()
        for coil in CHANNELS:
            self.hold(coil, 0.0)
        self.digitizer.release()
        self.pump.follow_trigger()

    def hold(self, coil: str, field_nT: float) -> None:
        """Put a steady field (or gradient, nT/cm) on a coil."""
        generator, channel = CHANNELS[coil]
        self.generators[generator].hold(channel, self.coils.voltage_V(coil, field_nT))
        if coil in self.held_nT:
            self.held_nT[coil] = field_nT

    @property
    def delay_s(self) -> float:
        """From the trigger to the field: until the light is surely off.

        Raises InstrumentError where nobody has measured how long the shutter takes.
        """
        dark_s = getattr(self.pump, "trigger_to_dark_s", None)
        if dark_s is None:
            raise InstrumentError(
                PUMP,
                "fire a shot",
                "its time from trigger to dark is not known",
                "measure it with a photodiode and write settings.trigger_to_dark in the bench file",
            )
        return SURE_OF_DARK * float(dark_s)

    def fire(self, field_nT: Mapping[str, float], said: str) -> Block:
        """Pump, switch the light off and the field on, and return the record.

        `field_nT` is added to what each coil holds. The record's time is zero at the trigger.
        Raises LightPassed where the shutter's sensor still says so after the record.
        """
        parameters = self.parameters
        armed = []
        duration_s = parameters.record_s + 2 * self.delay_s
        self.digitizer.prepare(
            parameters.sample_rate_Hz, parameters.record_s + self.delay_s, parameters.full_scale_V
        )
        for coil, field in field_nT.items():
            if field:
                generator, channel = CHANNELS[coil]
                voltage_V = self.coils.voltage_V(coil, field)
                self.generators[generator].prepare_step(
                    channel, voltage_V, duration_s, self.delay_s
                )
                armed.append((generator, channel))
        self.run.wait(parameters.pump_s, f"{said}: the vapour is pumped")
        self.digitizer.fire()
        block = self._fetched(said)
        light_passes = self.pump.is_open()
        self.digitizer.release()
        for generator, channel in armed:
            self.generators[generator].disarm(channel)
        if light_passes:
            raise LightPassed(
                PUMP,
                said,
                f"its sensor read open {1e3 * duration_s:.0f} ms after the trigger",
                "look whether the trigger's cable is at its gate and nothing holds the blade",
            )
        return block

    def _fetched(self, said: str) -> Block:
        clock = self.run.clock
        until_s = clock.now() + clock.patience_s(LONGEST_WAIT_S)
        while clock.now() < until_s:
            clock.sleep(LOOK_S)
            block = self.digitizer.fetch()
            self.run.say_progress(said)
            if block is not None:
                return block
        raise InstrumentError(
            DIGITIZER,
            f"record {said}",
            f"no record came within {LONGEST_WAIT_S:g} s",
            "look whether its trigger output is looped back to its trigger input",
        )

    def look(self, wanted: Wanted, said: str) -> Shot:
        """Fire a shot that is not recorded."""
        return self.shot_of(wanted, self.fire(wanted.by_coil_nT, said))

    def shot_of(self, wanted: Wanted, block: Block) -> Shot:
        """Return a record from the beginning of the field on."""
        import numpy as np

        from .dataset import Shot

        time_s = block.columns["time_s"] - self.delay_s
        after = time_s > 0.0
        return Shot(
            wanted.id,
            np.array(wanted.field_nT),
            time_s[after],
            block.columns["voltage_V"][after],
            self.parameters.full_scale_V,
        )
