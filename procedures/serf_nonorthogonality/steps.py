"""Steps 1 to 7 of the method for the angles between a SERF gyro's coils, with its own numbers.

Source: "In-situ calibration of the non-orthogonality angles of a SERF gyro's magnetic field by its
built-in magnetometer" (Chinese patent text 36201635, 2023-01-04), claims and steps 1 to 7.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.serf_nonorthogonality.cell import DIGITIZER, REPEATED, Cell, signal_of
from procedures.serf_nonorthogonality.nulling import fields_lost, null_residual_field
from procedures.serf_nonorthogonality.parameters import SerfParameters
from procedures.serf_nonorthogonality.shots import Wanted
from procedures.serf_nonorthogonality.single import bad_because, frequency_Hz
from station.errors import ConditionNotReached
from station.procedure import Prompt, Step

if TYPE_CHECKING:
    from drivers.roles import Block
    from station.runner.run import Run

CELL = "the cell"
FIRST_HZ = "the first shot's frequency"
SHOT_EXTRA_S = 1.2
NULLING_SHOTS = 14

CABLES = Prompt(
    "connect-cables",
    "Connect the generators to the coils x, y, z and the gradient coil, the detector to the "
    "digitizer, and the digitizer's trigger output to its trigger input, to the generators and to "
    "the shutter.",
)
HEAT = Prompt("heat-cell", "Bring the cell to its working temperature; note it as the answer.")
REST = Prompt("gyro-at-rest", "Fix the gyro at rest in inertial space, its loops open.")


def prompts(parameters: SerfParameters) -> tuple[Prompt, ...]:
    """Return what the operator may be asked to do."""
    return (CABLES, HEAT, REST)


def units(parameters: SerfParameters) -> tuple[str, ...]:
    """Return the units of work in the order they are measured: each shot."""
    return tuple(shot.id for shot in parameters.wanted)


def cell_of(run: Run) -> Cell:
    """Return the cell as this process of the run uses it."""
    if CELL not in run.handed_on:
        run.handed_on[CELL] = Cell(run)
    cell: Cell = run.handed_on[CELL]
    return cell


def all_finished(run: Run) -> bool:
    """Whether nothing is left to measure."""
    return all(run.is_finished(shot.id) for shot in run.parameters.wanted)


def depolarise(run: Run) -> None:
    """Step 1: cell warm, gyro at rest; where it was running, a gradient depolarises its nuclei."""
    parameters: SerfParameters = run.parameters
    run.ask(CABLES.id, CABLES.text)
    run.ask(HEAT.id, HEAT.text)
    run.ask(REST.id, REST.text)
    if all_finished(run):
        return
    cell = cell_of(run)
    cell.prepare()
    run.record.event("field-on", instrument="signal_generator")
    if not parameters.gyro_was_running:
        run.progress.say("    the gyro was not running: no nuclei to depolarise, as published")
        return
    rule = parameters.depolarise
    for attempt in range(1, rule.rounds + 1):
        cell.hold("gradient", rule.gradient_nT_per_cm)
        run.wait(rule.duration_s, "the gradient depolarises the nuclei")
        cell.hold("gradient", 0.0)
        seen_Hz = first_frequency_Hz(run, "the nuclei are looked for")
        low_Hz, high_Hz = expected_Hz(parameters)
        run.record.event("depolarised", attempt=attempt, frequency_Hz=seen_Hz)
        if seen_Hz is not None and low_Hz <= seen_Hz <= high_Hz:
            return
    raise ConditionNotReached(
        f"after {rule.rounds} times {rule.duration_s:g} s of {rule.gradient_nT_per_cm:g} nT/cm the "
        f"precession at the digitizer is {'not seen' if seen_Hz is None else f'{seen_Hz:.1f} Hz'}, "
        f"{low_Hz:.0f} Hz to {high_Hz:.0f} Hz would be right without a field of the nuclei; let "
        "the gradient act longer (depolarise.duration), look for a field that nobody commanded, or "
        "see that signal_generator.xy, signal_generator.z_gradient and pump_laser hear the trigger"
    )


def expected_Hz(parameters: SerfParameters) -> tuple[float, float]:
    """Return the bounds of the first shot's frequency where only its field is there."""
    from procedures.serf_nonorthogonality.parameters import SLOWING_DOWN

    field_nT = max(abs(field) for field in parameters.wanted[0].field_nT)
    low_q, high_q = SLOWING_DOWN[parameters.nuclear_spin]
    gamma = parameters.gyromagnetic_ratio_Hz_per_nT
    slack = fields_lost(field_nT)
    return gamma * field_nT / high_q * (1 - slack), gamma * field_nT / low_q * (1 + slack)


def first_frequency_Hz(run: Run, said: str) -> float | None:
    """Fire the plan's first shot, as a look, and return its frequency; None where none is seen."""
    cell = cell_of(run)
    shot: Wanted = run.parameters.wanted[0]
    block = cell.fire(dict(zip("xyz", shot.field_nT, strict=True)), said)
    time_s, voltage_V = signal_of(block, cell.delay_s)
    return frequency_Hz(time_s, voltage_V, run.parameters.mains_frequency_Hz)


def null(run: Run) -> None:
    """Step 2: the gradient is off; the residual field is nulled by what the spins tell of it."""
    if all_finished(run):
        return
    run.may_pause()
    null_residual_field(run, cell_of(run))


def take(run: Run, shot: Wanted) -> None:
    """Take one shot; a bad one is taken again, up to the plan's number of times.

    One that stays bad is kept as it is: the analysis leaves it out, and says so.
    """
    parameters: SerfParameters = run.parameters
    if run.is_finished(shot.id):
        return
    run.may_pause()
    cell = cell_of(run)
    fields_nT = dict(zip("xyz", shot.field_nT, strict=True))
    details = {
        "field_nT": list(shot.field_nT),
        "held_nT": [cell.held_nT[axis] for axis in "xyz"],
        "delay_s": cell.delay_s,
    }
    with run.unit(shot.id, **details):
        for attempt in range(parameters.repeats + 1):
            block = cell.fire(fields_nT, f"shot {shot.id}")
            keep(run, shot.id, block)
            reason = bad_because(block, cell.delay_s, parameters)
            if reason is None:
                return
            run.progress.say(f"    {shot.id}: {reason}")
            if attempt < parameters.repeats:
                run.record.event(REPEATED, unit=shot.id, reason=reason)
        run.record.event("shot-stays-bad", unit=shot.id, reason=reason)


def keep(run: Run, unit: str, block: Block) -> None:
    """Record a shot's rows; each attempt begins with an earlier time than the last one ended."""
    from station.runner.acquisition import to_rows

    source = cell_of(run).digitizer
    run.record.block(source.source, unit, source.columns, to_rows(block))


def first_shot(run: Run) -> None:
    """Step 3: the field of one coil on and the pump light off together; the signal is recorded."""
    take(run, run.parameters.wanted[0])


def read_slowing_down(run: Run) -> None:
    """Step 4: the frequency of the first shot gives the slowing-down factor Q."""
    parameters: SerfParameters = run.parameters
    seen_Hz = recorded_frequency_Hz(run, parameters.wanted[0].id)
    run.handed_on[FIRST_HZ] = seen_Hz
    if seen_Hz is not None:
        field_nT = max(abs(field) for field in parameters.wanted[0].field_nT)
        q = parameters.gyromagnetic_ratio_Hz_per_nT * field_nT / seen_Hz
        run.record.event("published-value", name="slowing_down_factor", value=q, unit="1")
        run.progress.say(f"    {seen_Hz:.2f} Hz, Q = {q:.3f}")


def recorded_frequency_Hz(run: Run, unit: str) -> float | None:
    """Return the frequency of a recorded shot, read back from the record."""
    from procedures.serf_nonorthogonality.from_record import shot_of_unit

    time_s, voltage_V = shot_of_unit(run.read_back(), unit)
    return frequency_Hz(time_s, voltage_V, run.parameters.mains_frequency_Hz)


def first_pair(run: Run) -> None:
    """Step 5: two coils together, the pump light off, and the signal is recorded."""
    take(run, run.parameters.wanted[1])


def read_first_angle(run: Run) -> None:
    """Step 6: its frequency gives the total field; the law of cosines gives the angle."""
    import math

    parameters: SerfParameters = run.parameters
    shot = parameters.wanted[1]
    first_Hz, seen_Hz = run.handed_on.get(FIRST_HZ), recorded_frequency_Hz(run, shot.id)
    if first_Hz is None or seen_Hz is None:
        return
    alone_nT = max(abs(field) for field in parameters.wanted[0].field_nT)
    total_nT = seen_Hz / first_Hz * alone_nT
    one, other = (field for field in shot.field_nT if field)
    cosine = (total_nT**2 - one**2 - other**2) / (2 * one * other)
    if abs(cosine) < 1:
        angle_deg = math.degrees(math.acos(cosine))
        run.record.event(
            "published-value",
            name="nonorthogonality_angle",
            axis=shot.coils,
            value=angle_deg,
            unit="deg",
        )
        run.progress.say(f"    as published theta_{shot.coils} = {angle_deg:.3f} deg")


def other_shots(run: Run) -> None:
    """Step 7: the same for the other pairs, and every other shot of the plan; then all off."""
    wanted = run.parameters.wanted
    for number, shot in enumerate(wanted[2:], 3):
        take(run, shot)
        run.say_progress(f"shot {number} of {len(wanted)}")
    cell = cell_of(run)
    cell.pump.close_shutter()
    for generator in cell.generators.values():
        for channel in (1, 2):
            generator.switch_off(channel)
    run.record.event("field-off", instrument="signal_generator")


def shot_s(parameters: SerfParameters) -> float:
    """Return the expected bench time in s of one shot."""
    return parameters.pump_s + parameters.record_s + SHOT_EXTRA_S


def depolarise_s(parameters: SerfParameters) -> float:
    """Return the expected bench time in s of step 1."""
    if not parameters.gyro_was_running:
        return 1.0
    return parameters.depolarise.duration_s + shot_s(parameters)


def null_s(parameters: SerfParameters) -> float:
    """Return the expected bench time in s of step 2: two rounds, of at most those of the plan."""
    return min(parameters.nulling.rounds, 2) * NULLING_SHOTS * shot_s(parameters)


STEPS = (
    Step("1", "Warm cell, gyro at rest; depolarise the nuclei", depolarise, depolarise_s),
    Step("2", "Gradient off; null the residual field", null, null_s),
    Step("3", "One coil on, pump light off, record the precession", first_shot, shot_s),
    Step("4", "Read the frequency: slowing-down factor Q", read_slowing_down, lambda _: 0.0),
    Step("5", "Two coils on, pump light off, record", first_pair, shot_s),
    Step("6", "Read the frequency: total field, angle", read_first_angle, lambda _: 0.0),
    Step(
        "7",
        "The other pairs, and the other shots of the plan",
        other_shots,
        lambda p: (len(p.wanted) - 2) * shot_s(p),
    ),
)

INSTRUMENTS = ("signal_generator.xy", "signal_generator.z_gradient", DIGITIZER, "pump_laser")


def instruments(parameters: SerfParameters) -> tuple[str, ...]:
    """Return the bench instances that every plan needs."""
    return INSTRUMENTS
