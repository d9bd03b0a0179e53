"""The cell on the bench: one shot, and step 2, the nulling of the residual field.

The source nulls by modulation. That finds the zero only within the width of the magnetometer's
resonance, a nanotesla or two; fields of both senses show the residual field at any size, on the
scale of the coils themselves. What is left is part of the results.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from station.errors import ConditionNotReached, InstrumentError
from station.method.cell_commands import PumpLight, TriggeredCellField, dark_after_s

from .parameters import SerfParameters
from .shots import AXES, Wanted, shots_of
from .work import CHANNELS, DIGITIZER, GENERATOR_XY, GENERATOR_Z, PUMP, fields_of, held

if TYPE_CHECKING:
    from station.method.run import Run
    from station.roles.base import Block

    from .dataset import Shot
    from .precession import Precession
    from .tone import ToneFit

LOOK_S = 0.02
MIN_SLACK = 0.1
USUAL_RESIDUAL_NT = 5.0


class Cell:
    """The instruments about the cell, as one run uses them."""

    def __init__(self, run: Run) -> None:
        from station.roles import Digitizer, PumpLaser, SignalGenerator

        self.run = run
        self.parameters: SerfParameters = run.parameters
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
            self.release(coil)
        self.digitizer.release()
        self.run.apply(PumpLight(PUMP, True))

    def release(self, coil: str) -> None:
        """Take the steady field of a coil away."""
        generator, channel = CHANNELS[coil]
        self.generators[generator].hold(channel, 0.0)

    def add(self, coil: str, field_nT: float) -> None:
        """Add to the steady field of a coil, against the residual field."""
        self.held_nT[coil] += field_nT
        self.run.apply(held(coil, self.held_nT[coil], "against the residual field: "))

    @property
    def delay_s(self) -> float:
        """From the trigger to the field: until the light is surely off."""
        return dark_after_s(self.run, PUMP)

    def fire(self, fields: Sequence[TriggeredCellField], doing: str) -> Block:
        """Pump, switch the light off and the fields on, and return the record.

        The fields are added to what each coil holds. The record's time is zero at the trigger.
        Raises LightPassed where the shutter's sensor still reads open after the record.
        """
        from station.method.verbs import fetch_bursts

        parameters = self.parameters
        duration_s = parameters.record_s + 2 * self.delay_s
        self.digitizer.prepare(
            parameters.sample_rate_Hz, parameters.record_s + self.delay_s, parameters.full_scale_V
        )
        for field in fields:
            self.run.apply(field)
        self.run.wait(parameters.pump_s, f"{doing}: the vapour is pumped")
        self.digitizer.fire()
        records = fetch_bursts(
            self.run,
            doing,
            {DIGITIZER: self.digitizer},
            every_s=LOOK_S,
            doing=doing,
            look_at="look whether its trigger output is looped back to its trigger input",
        )
        _, block = next(records)
        light_passes = self.pump.is_open()
        self.digitizer.release()
        for field in fields:
            self.generators[field.instrument].disarm(field.channel)
        if light_passes:
            raise LightPassed(
                PUMP,
                doing,
                f"its sensor read open {1e3 * duration_s:.0f} ms after the trigger",
                "look whether the trigger's cable is at its gate and nothing holds the blade",
            )
        return block

    def look(self, wanted: Wanted, doing: str) -> Shot:
        """Fire a shot that is not recorded."""
        fields = fields_of(wanted, self.parameters, doing)
        return self.shot_of(wanted, self.fire(fields, doing))

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


class LightPassed(InstrumentError):
    """The pump light was not blocked during a shot."""


def fields_lost(field_nT: float) -> float:
    """Return by which part a shield's usual residual field may change a precession."""
    return max(MIN_SLACK, USUAL_RESIDUAL_NT / field_nT)


def null_residual_field(run: Run, cell: Cell) -> None:
    """Solve the residual field from shots of every polarity, take it off, and look again.

    A field that is larger than a shield's, or not steady, is not nulled, and the run goes on: what
    is there is part of the results. Raises ConditionNotReached where hardly a shot can be used.
    """
    parameters: SerfParameters = run.parameters
    rule, levels_nT = parameters.nulling, parameters.field_levels_nT
    shots = shots_of("reversal", levels_nT, parameters.pump_axis, parameters.probe_axis)
    for number in range(1, rule.rounds + 1):
        doing = f"nulling, round {number}"
        looks = []
        for place, shot in enumerate(shots, 1):
            looks.append(cell.look(shot, f"{doing}, shot {place} of {len(shots)}"))
        seen = look_at_shots(looks, parameters)
        cell.usual = [precession.used_fit for precession in seen if precession.used]
        residual_nT = solved_residual_nT(seen, doing)
        run.event("residual-field", round=number, field_nT=residual_nT)
        if residual_nT is None:
            run.say("    the residual field is not steady: it is not nulled")
            return
        size_nT = math.hypot(*residual_nT.values())
        run.say(f"    residual field {size_nT:.2f} nT in round {number}")
        if size_nT <= rule.tolerance_nT:
            return
        if size_nT > rule.at_most_nT:
            run.say(
                f"    more than nulling.at_most, {rule.at_most_nT:g} nT: not the shield's, and not "
                "nulled; were the nuclei depolarised?"
            )
            return
        for axis in AXES:
            cell.add(axis, -residual_nT[axis])


def look_at_shots(looks: Sequence[Shot], parameters: SerfParameters) -> list[Precession]:
    """Return the fits of shots, all with one decay of the baseline.

    A shot alone may take a baseline for its tone.
    """
    from .dataset import SerfDataset
    from .precession import look_at_all
    from .settings import AnalysisSettings

    dataset = SerfDataset(
        looks,
        parameters.pump_axis,
        parameters.probe_axis,
        parameters.nuclear_spin,
        constants_known=False,
        sample_rate_Hz=parameters.sample_rate_Hz,
        mains_Hz=parameters.mains_frequency_Hz,
    )
    return look_at_all(dataset, AnalysisSettings())


def solved_residual_nT(seen: Sequence[Precession], doing: str) -> dict[str, float] | None:
    """Return the fields of the three coils, in nT commanded, that make up the residual field.

    None where no residual field explains the shots. Raises ConditionNotReached with too few.
    """
    import numpy as np

    from .angles import solve

    used = [precession for precession in seen if precession.used]
    bad = [precession for precession in seen if not precession.used]
    solution = None
    if used:
        solution = solve(
            np.array([precession.shot.field_nT for precession in used]),
            np.array([precession.used_fit.omega_rad_per_s for precession in used]),
            np.diag([precession.used_fit.omega_u**2 for precession in used]),
            known=False,
        )
    if solution is None or (bad and not solution.free_of_residual):
        raise ConditionNotReached(
            f"{doing}: the shot {bad[0].shot.name} cannot be used ({bad[0].rejected}); look at the "
            "pump light, the probe light, the cell's temperature and the coils' cables"
        )
    if not (solution.converged and solution.positive_definite):
        return None
    # r holds projections on the axes, which are not quite at right angles.
    along = np.linalg.solve(solution.gram, solution.residual) / solution.scale
    return {axis: round(component, 4) for axis, component in zip(AXES, along.tolist(), strict=True)}
