"""The cell on the bench: its instruments, one shot, and step 2, the nulling of the residual field.

The source nulls by modulation (`nulling_by_tones`). That finds the zero only near the width of the
magnetometer's resonance, a nanotesla or two; fields of both senses show the residual field at any
size, on the scale of the coils themselves. What is left is part of the results.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

from station.errors import ConditionNotReached, InstrumentError
from station.method.cell_commands import (
    CellField,
    CellTone,
    NulledCellFields,
    PumpLight,
    TriggeredCellField,
    dark_after_s,
)
from station.method.duration import Duration, exactly
from station.method.verbs import fetch_bursts
from station.roles import Digitizer, PumpLaser, SignalGenerator

from .oven import LOOKS, record
from .parameters import SerfParameters
from .shots import AXES, Wanted, shots_of

if TYPE_CHECKING:
    from station.method.run import Run
    from station.roles.base import Block

    from .dataset import Precession, Shot
    from .tone import ToneFit

GENERATOR_XY, GENERATOR_Z = "signal_generator.xy", "signal_generator.z_gradient"
DIGITIZER, PUMP = "digitizer", "pump_laser"
CHANNELS: Mapping[str, tuple[str, int]] = {
    "x": (GENERATOR_XY, 1),
    "y": (GENERATOR_XY, 2),
    "z": (GENERATOR_Z, 1),
    "gradient": (GENERATOR_Z, 2),
}
"""The generator and the channel at each coil, as the names of the instances say."""
FIELD = ("parameters", "field")
TONE = ("parameters", "nulling", "tone")
SHOT_EXTRA_S = 0.05
"""From the trigger to the dark, twice, and what it takes to ask for the record."""
USUAL_ROUNDS = 2
NULLING_MARGIN = 2.0
"""Rounds of nulling correct each other: no more than so many times `at_most` is held."""
LOOK_S = 0.02
MIN_SLACK = 0.1
USUAL_RESIDUAL_NT = 5.0


def held(coil: str, size: float, purpose: str = "") -> CellField:
    """Return a steady field at a coil, in nT, or nT/cm of the gradient."""
    return CellField(*CHANNELS[coil], coil, size, purpose, decided_by=FIELD)


def fields_of(
    shot: Wanted, parameters: SerfParameters, look: str = ""
) -> tuple[TriggeredCellField, ...]:
    """Return the field of each coil of a shot; `look` is why one is fired beside the record."""
    return tuple(
        TriggeredCellField(
            *CHANNELS[coil],
            coil,
            field_nT,
            f"{look or f'shot {shot.id}'}: ",
            record_s=parameters.record_s,
            shutter=PUMP,
            decided_by=FIELD,
        )
        for coil, field_nT in shot.by_coil_nT.items()
        if field_nT
    )


def record_s(parameters: SerfParameters) -> Duration:
    """Return how long a record takes from the trigger on; it is waited for."""
    return waited_for(parameters.record_s)


def waited_for(least_s: float) -> Duration:
    """Return how long a record of so many seconds takes from the trigger on."""
    return Duration(least_s + SHOT_EXTRA_S, least_s, least_s + 2.0 * SHOT_EXTRA_S)


def shots_s(parameters: SerfParameters, least: int, expected: int, most: int) -> Duration:
    """Return how long shots take whose number the data decide."""
    each = exactly(parameters.pump_s) + record_s(parameters)
    return Duration(expected * each.expected_s, least * each.shortest_s, most * each.longest_s)


class Cell:
    """The instruments about the cell, as one run uses them."""

    def __init__(self, run: Run) -> None:
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
        return self.run.read(lambda: dark_after_s(self.run, PUMP), assumed=0.0)

    def fire(self, fields: Sequence[TriggeredCellField], doing: str, unit: str = LOOKS) -> Block:
        """Pump, switch the light off and the fields on, and return the record.

        The cell's temperature before is recorded for `unit`, where its heater is driven. The fields
        are added to what each coil holds. The record's time is zero at the trigger.
        Raises LightPassed where the shutter's sensor still reads open after the record.
        """
        parameters = self.parameters
        self.digitizer.prepare(
            parameters.sample_rate_Hz, parameters.record_s + self.delay_s, parameters.full_scale_V
        )
        for field in fields:
            self.run.apply(field)
        self.run.wait(parameters.pump_s, f"{doing}: the vapour is pumped")
        record(self.run, unit)
        self.digitizer.fire()
        block, light_passes = self.run.read(
            partial(self._fetch, doing), assumed=(None, False), takes=record_s(parameters)
        )
        self.digitizer.release()
        for field in fields:
            self.generators[field.instrument].disarm(field.channel)
        if light_passes:
            duration_s = parameters.record_s + 2 * self.delay_s
            raise LightPassed(
                PUMP,
                doing,
                f"its sensor read open {1e3 * duration_s:.0f} ms after the trigger",
                "look whether the trigger's cable is at its gate and nothing holds the blade",
            )
        return block

    def tone(self, coil: str, middle_nT: Mapping[str, float], doing: str) -> Block:
        """Send a tone on a coil, all coils about a middle beside what they hold, in steady light.

        Return the record, its time zero at the tone's first rise. The coils stay as they are.
        """
        rule, rate_Hz = self.parameters.nulling, self.parameters.tone_rate_Hz
        for name, beside_nT in middle_nT.items():
            lowest_nT = beside_nT - (rule.tone_nT if name == coil else 0.0)
            self.run.apply(held(name, self.held_nT[name] + lowest_nT, f"{doing}: "))
        cycles = math.ceil(rule.record_s * rule.frequency_Hz) + 1
        swing_nT, half_s = 2.0 * rule.tone_nT, rule.half_s
        self.run.apply(
            CellTone(
                *CHANNELS[coil],
                coil,
                swing_nT,
                f"{doing}: ",
                half_s=half_s,
                cycles=cycles,
                decided_by=TONE,
            )
        )
        self.digitizer.prepare(rate_Hz, rule.record_s, self.parameters.full_scale_V)
        self.run.wait(self.parameters.pump_s, f"{doing}: the vapour is pumped")
        record(self.run, LOOKS)
        self.digitizer.fire()
        block, light_passes = self.run.read(
            partial(self._fetch, doing), assumed=(None, True), takes=waited_for(rule.record_s)
        )
        self.digitizer.release()
        generator, channel = CHANNELS[coil]
        self.generators[generator].disarm(channel)
        if not light_passes:
            raise InstrumentError(
                PUMP,
                doing,
                "its sensor read closed during a tone, which the light has to pass",
                "look at its interlock, and that nothing holds the blade",
            )
        return block

    def _fetch(self, doing: str) -> tuple[Block, bool]:
        """Return the record, and whether the light still passes after it."""
        records = fetch_bursts(
            self.run,
            doing,
            {DIGITIZER: self.digitizer},
            every_s=LOOK_S,
            doing=doing,
            look_at="look whether its trigger output is looped back to its trigger input",
        )
        _, block = next(records)
        return block, self.pump.is_open()

    def look(self, wanted: Wanted, doing: str) -> Shot:
        """Fire a shot that is not recorded."""
        block = self.fire(fields_of(wanted, self.parameters, doing), doing)
        return self.run.read(lambda: self.shot_of(wanted, block))

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
    is there is part of the results. A dry run goes through one round, which leaves nothing to null.
    Raises ConditionNotReached where hardly a shot can be used.
    """
    parameters: SerfParameters = run.parameters
    levels_nT = parameters.field_levels_nT
    shots = shots_of("reversal", levels_nT, parameters.pump_axis, parameters.probe_axis)
    rounds = parameters.nulling.rounds
    counts = (len(shots) * number for number in (min(rounds, 1), min(rounds, USUAL_ROUNDS), rounds))
    for number in run.repeats(range(1, rounds + 1), shots_s(parameters, *counts)):
        run.declare(*nulled_fields(parameters))
        looks = [
            cell.look(shot, f"nulling, round {number}, shot {place} of {len(shots)}")
            for place, shot in enumerate(shots, 1)
        ]
        residual_nT = run.read(partial(residual_to_null, run, cell, looks, number))
        if residual_nT is None:
            return
        for axis in AXES:
            cell.add(axis, -residual_nT[axis])


def nulled_fields(parameters: SerfParameters) -> tuple[NulledCellFields, ...]:
    """Return how far the fields go that are solved from data, by generator."""
    rule = parameters.nulling
    most_nT = NULLING_MARGIN * rule.at_most_nT
    if rule.method == "modulation":
        most_nT += rule.bias_nT + rule.tone_nT
    return tuple(
        NulledCellFields(
            generator,
            f"at most {most_nT:g} nT against the residual field at {', '.join(coils)}",
            coils,
            most_nT,
            decided_by=("parameters", "nulling", "at_most"),
        )
        for generator, coils in ((GENERATOR_XY, "xy"), (GENERATOR_Z, "z"))
    )


def residual_to_null(
    run: Run, cell: Cell, looks: Sequence[Shot], number: int
) -> dict[str, float] | None:
    """Return the residual field that a round of shots shows, None where it is left as it is."""
    parameters: SerfParameters = run.parameters
    rule = parameters.nulling
    seen = look_at_shots(looks, parameters)
    cell.usual = [precession.used_fit for precession in seen if precession.used]
    residual_nT = solved_residual_nT(seen, f"nulling, round {number}")
    run.event("residual-field", round=number, field_nT=residual_nT)
    if residual_nT is None:
        run.say("    the residual field is not steady: it is not nulled")
        return None
    size_nT = math.hypot(*residual_nT.values())
    run.say(f"    residual field {size_nT:.2f} nT in round {number}")
    if size_nT <= rule.tolerance_nT:
        return None
    if size_nT > rule.at_most_nT:
        run.say(
            f"    more than nulling.at_most, {rule.at_most_nT:g} nT: not the shield's, and not "
            "nulled; were the nuclei depolarised?"
        )
        return None
    return residual_nT


def look_at_shots(looks: Sequence[Shot], parameters: SerfParameters) -> list[Precession]:
    """Return the fits of shots, all with one decay of the baseline.

    A shot alone may take a baseline for its tone.
    """
    from .dataset import SerfDataset
    from .parameters import AnalysisSettings
    from .precession import look_at_all

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
            f"{doing}: the shot {bad[0].name} cannot be used ({bad[0].rejected}); look at the "
            "pump light, the probe light, the cell's temperature and the coils' cables"
        )
    if not solution.sound:
        return None
    # r holds projections on the axes, which are not quite at right angles.
    along = np.linalg.solve(solution.gram, solution.residual) / solution.scale
    return {axis: round(component, 4) for axis, component in zip(AXES, along.tolist(), strict=True)}
