"""Faults that a commissioning must name, as a simulated bench is given them."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from commissioning_parts import bench_plan_of, whole_plan_of
from plan_runs import run_of, shipped_bench

from station.runner.outcome import Outcome

Bench = dict[str, Any]
Planted = tuple[str, str | None]
"""The code and the axis of the flag that names it."""


@dataclass(frozen=True)
class Ends:
    """A run that a fault ends: its exit code, and words of its sentence, which name the fault."""

    exit_code: int
    words: tuple[str, ...]


@dataclass(frozen=True)
class Plant:
    """A fault of some size at some place: `plant` changes a bench's data and returns its flag.

    `part` is the part of the commissioning that must name it, `benches` are the shipped ones that
    have what it needs.
    """

    name: str
    part: str
    plant: Callable[[Bench, random.Random], Planted | Ends]
    benches: tuple[str, ...] = ("sim",)
    lasts: bool = True
    """Whether the run goes through all its steps with it."""


NO_CAUSE = ("simulated", "not-tried")


def named(outcome: Outcome) -> set[Planted]:
    """Return code and axis of each flag, those of the simulation and of what was left out aside."""
    assert outcome.document is not None, outcome.error
    flags = outcome.document.to_data()["flags"]
    return {(one["code"], one["axis"]) for one in flags if one["code"] not in NO_CAUSE}


BOTH = ("sim", "sim-alternate")


def is_named(outcome: Outcome, expected: Planted | Ends) -> bool:
    """Whether a commissioning names a fault, and nothing else."""
    if isinstance(expected, Ends):
        said = str(outcome.error)
        return outcome.exit_code == expected.exit_code and all(w in said for w in expected.words)
    return outcome.exit_code == 1 and named(outcome) == {expected}


SUPPLIES = ("coil_supply.x", "coil_supply.y", "coil_supply.z")
ALTERNATE = ("sim-alternate",)
CONTACTS = ("e-stop", "door")


def exchanged_serials(bench: Bench, rng: random.Random) -> Ends:
    one, other = rng.sample(SUPPLIES, 2)
    entries = [bench["instruments"][name] for name in (one, other)]
    for entry, answers in zip(entries, [e["serial"] for e in reversed(entries)], strict=True):
        entry["simulator"]["serial"] = answers
    return Ends(3, (f"{one}: serial number", f"{other}: serial number", "the two are exchanged"))


def one_address_twice(bench: Bench, rng: random.Random) -> Ends:
    one, other = rng.sample(SUPPLIES, 2)
    instruments = bench["instruments"]
    instruments[other]["simulator"]["serial"] = instruments[one]["serial"]
    return Ends(3, (one, other, "the addresses of both lead to one instrument"))


def open_chain(bench: Bench, rng: random.Random) -> Ends:
    contact = rng.choice(CONTACTS)
    fault = {"instrument": "interlock_chain", "fault": "chain-open", "contact": contact}
    bench["simulation"]["faults"] = [{**fault, "at": "0 s", "for": "1 h"}]
    return Ends(5, (f"open: {contact}",))


def inverted_door_in_chain(bench: Bench, rng: random.Random) -> Ends:
    inputs = bench["instruments"]["thermal_chamber"]["simulator"]
    inputs["door_inverted"] = True
    return Ends(5, ("open: thermal_chamber door",))


AXES = ("x", "y", "z")


def swapped_coils(bench: Bench, rng: random.Random) -> Planted:
    one, other = (bench["instruments"][f"coil_supply.{axis}"] for axis in rng.sample(AXES, 2))
    coils = one["simulator"]["coil"], other["simulator"]["coil"]
    other["simulator"]["coil"], one["simulator"]["coil"] = coils
    return "coils-swapped", None


def reversed_coil(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(AXES)
    bench["simulation"]["coils"][axis]["reversed"] = True
    return "coil-polarity-reversed", axis


def constant_off(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(AXES)
    off_by = rng.choice((-1.0, 1.0)) * rng.uniform(0.03, 0.06)
    settings = bench["instruments"][f"coil_supply.{axis}"]["settings"]
    stated = float(settings["coil_constant"].split()[0])
    settings["coil_constant"] = f"{stated * (1.0 + off_by):.6f} mT/A"
    return "coil-constant-off", axis


def _wire_probe(bench: Bench, exchanged: dict[str, str]) -> None:
    """Wire what the probe shows otherwise, beside what another plant did."""
    wiring = bench["instruments"]["gaussmeter"]["simulator"].setdefault("wiring", {})
    before = {axis: wiring.get(axis, axis) for axis in AXES}
    for axis, shows in exchanged.items():
        was = before[shows[-1]]
        wiring[axis] = was if len(shows) == 1 else was[1:] if was[0] == "-" else f"-{was}"


def swapped_probe(bench: Bench, rng: random.Random) -> Planted:
    one, other = rng.sample(AXES, 2)
    _wire_probe(bench, {one: other, other: one})
    return "probe-axes-swapped", None


def reversed_probe(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(AXES)
    _wire_probe(bench, {axis: f"-{axis}"})
    return "probe-axis-reversed", axis


def leaning_coil(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(AXES)
    normal = bench["simulation"]["coils"][axis]["normal"]
    towards = rng.choice(sorted(normal))
    normal[towards] = f"{rng.choice((-1.0, 1.0)) * rng.uniform(5.0, 10.0):.2f} deg"
    return "coil-leans", axis


ASKED_IN_ONE_QUERY = ("coil_supply.x", "coil_supply.dc", "gaussmeter", "multimeter")
"""Instruments whose identity is one answer to `*IDN?`."""
TRIES = 3
"""So often a driver asks before it gives an answer up."""


def faulty(bench: Bench, name: str, **fault: Any) -> None:
    bench["simulation"].setdefault("faults", []).append(
        {"instrument": name, "command": "*IDN?", **fault}
    )


def slow_line(bench: Bench, rng: random.Random) -> Planted:
    name, delay_s = rng.choice(ASKED_IN_ONE_QUERY), rng.uniform(0.27, 0.4)
    faulty(bench, name, fault="late", delay=f"{delay_s:.3f} s", **{"for": "1 h"})
    return "line-slow", name


def lost_answers(bench: Bench, rng: random.Random) -> Planted:
    name = rng.choice(ASKED_IN_ONE_QUERY)
    faulty(bench, name, fault="no-reply", nth=rng.randint(10, 40), count=TRIES)
    return "line-loses-answers", name


def inverted_door(bench: Bench, rng: random.Random) -> Planted:
    bench["instruments"]["thermal_chamber"]["simulator"]["door_inverted"] = True
    return "door-contact-inverted", None


def stuck_door(bench: Bench, rng: random.Random) -> Planted:
    # The input that the bench file states is another one.
    bench["instruments"]["thermal_chamber"]["simulator"]["inputs"] = {"2.2": "spare"}
    return "door-contact-stuck", None


def bridged_contact(bench: Bench, rng: random.Random) -> Planted:
    bench["instruments"]["interlock_chain"]["simulator"]["bridged"] = rng.choice(CONTACTS)
    return "chain-contact-bridged", None


COILS = ("x", "y", "z")


def own_limit_broken(bench: Bench, rng: random.Random) -> Planted:
    coil = rng.choice(COILS)
    bench["instruments"][f"coil_supply.{coil}"]["simulator"]["own_limit_broken"] = True
    return "own-limit-does-not-act", coil


def output_stays_on(bench: Bench, rng: random.Random) -> Planted:
    coil = rng.choice(COILS)
    bench["instruments"][f"coil_supply.{coil}"]["simulator"]["output_stays_on"] = True
    return "output-stays-on", coil


def off_centre(bench: Bench, rng: random.Random) -> Planted:
    axis, sense = rng.choice("xyz"), rng.choice((-1.0, 1.0))
    bench["simulation"]["probe_position"][axis] = f"{sense * rng.uniform(75.0, 95.0):.1f} mm"
    return "probe-off-centre", None


def picked_up(bench: Bench, rng: random.Random) -> Planted:
    # 0.5 mT at coils of 0.30 to 0.375 mT/A: 1.3 A to 1.7 A, a sine each.
    bench["instruments"]["multimeter"]["simulator"]["pick_up"] = f"{rng.uniform(8.0, 80.0):.1f} uV"
    return "pick-up", None


TABLE_AXES = ("outer", "middle", "inner")


def reversed_sense(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(TABLE_AXES)
    bench["simulation"]["fog"]["table"][axis]["reversed"] = True
    return "table-sense-reversed", axis


def zero_off(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(("middle", "inner"))
    number = bench["instruments"]["turntable"]["settings"][f"{axis}_axis"]
    off_deg = rng.choice((-1.0, 1.0)) * rng.uniform(0.05, 0.5)
    controller = bench["instruments"]["turntable"]["simulator"]
    controller[f"axis_{number}"]["encoder_offset"] = f"{off_deg:.4f} deg"
    return "table-zero-off", axis


LEANS = {
    "outer": ("towards_x", "towards_y"),
    "middle": ("towards_z",),
    "inner": ("towards_z",),
}
"""What gravity feels of each."""


def leaning(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(TABLE_AXES)
    towards = rng.choice(LEANS[axis])
    off_deg = rng.choice((-1.0, 1.0)) * rng.uniform(0.1, 0.5)
    bench["simulation"]["fog"]["table"][axis]["lean"][towards] = f"{off_deg:.4f} deg"
    return "table-axis-leans", axis


def off_square(bench: Bench, rng: random.Random) -> Planted:
    axis, towards = rng.choice((("middle", "towards_x"), ("inner", "towards_y")))
    off_deg = rng.choice((-1.0, 1.0)) * rng.uniform(0.15, 0.5)
    bench["simulation"]["fog"]["table"][axis]["lean"][towards] = f"{off_deg:.4f} deg"
    return "table-axes-not-square", None


def swapped_gyros(bench: Bench, rng: random.Random) -> Planted:
    one, other = rng.sample(("x", "y", "z"), 2)
    gyros = bench["simulation"]["nine_axis"]["sensor"]["gyros"]
    gyros["wiring"] = {one: other, other: one}
    return "gyro-channels-swapped", None


def reversed_gyro(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(("x", "y", "z"))
    bench["simulation"]["nine_axis"]["sensor"]["gyros"]["wiring"] = {axis: f"-{axis}"}
    return "gyro-channel-reversed", axis.upper()


def reversed_stage(bench: Bench, rng: random.Random) -> Planted:
    bench["simulation"]["accelerometer"]["reversed"] = True
    return "stage-sense-reversed", None


def stage_zero_off(bench: Bench, rng: random.Random) -> Planted:
    off_deg = rng.choice((-1.0, 1.0)) * rng.uniform(0.05, 0.5)
    bench["instruments"]["rotary_stage"]["simulator"]["encoder_offset"] = f"{off_deg:.4f} deg"
    return "stage-zero-off", None


def stage_leaning(bench: Bench, rng: random.Random) -> Planted:
    off_deg = rng.choice((-1.0, 1.0)) * rng.uniform(0.1, 0.5)
    bench["simulation"]["accelerometer"]["axis_tilt"] = f"{off_deg:.4f} deg"
    return "stage-axis-leans", None


def pulse_weight_off(bench: Bench, rng: random.Random) -> Planted:
    off_by = rng.choice((-1.0, 1.0)) * rng.uniform(0.01, 0.05)
    gyro = bench["simulation"]["gyro"]
    weight_arcsec = float(gyro["pulse_weight"].split()[0])
    gyro["pulse_weight"] = f"{weight_arcsec * (1.0 + off_by):.8f} arcsec"
    return "pulse-weight-off", None


def other_channel(bench: Bench, rng: random.Random) -> Planted:
    bench["simulation"]["gyro"]["channel"] = rng.choice((2, 3))
    return "gyro-on-other-channel", None


def overshooting(bench: Bench, rng: random.Random) -> Planted:
    bench["simulation"]["fog"]["chamber"]["overshoot"] = f"{rng.uniform(35.0, 80.0):.0f} %"
    return "chamber-overshoots", None


def wrong_channel(bench: Bench, rng: random.Random) -> Planted:
    axis, shows = rng.choice("xyz"), rng.choice(("room", "air"))
    bench["simulation"]["fog"]["gyros"]["sensor_wiring"] = {axis: shows}
    return "thermometer-wrong-channel", axis


def gaussmeter_clock(bench: Bench, rng: random.Random) -> Planted:
    off = rng.choice((-1, 1)) * rng.uniform(200, 2000)
    bench["instruments"]["gaussmeter"]["simulator"]["clock_error"] = f"{off:.1f} ppm"
    return "clock-off", "gaussmeter"


def board_clock(bench: Bench, rng: random.Random) -> Planted:
    off = rng.choice((-1, 1)) * rng.uniform(200, 2000)
    bench["instruments"]["gyro_acquisition"]["simulator"]["clock_error"] = f"{off:.1f} ppm"
    return "clock-off", "gyro_acquisition"


PLANTS: tuple[Plant, ...] = (
    Plant("exchanged serial numbers", "coils", exchanged_serials, BOTH, lasts=False),
    Plant("two supplies at one address", "coils", one_address_twice, BOTH, lasts=False),
    Plant("open interlock chain", "contacts", open_chain, lasts=False),
    Plant(
        "inverted door contact in the chain",
        "contacts",
        inverted_door_in_chain,
        ALTERNATE,
        lasts=False,
    ),
    Plant("swapped coils", "coils", swapped_coils, BOTH),
    Plant("reversed polarity", "coils", reversed_coil, BOTH),
    Plant("coil constant off", "coils", constant_off, BOTH),
    Plant("swapped gaussmeter axes", "coils", swapped_probe),
    Plant("reversed probe axis", "coils", reversed_probe),
    Plant("leaning coil", "coils", leaning_coil, BOTH),
    Plant("slow line", "lines", slow_line),
    Plant("line that loses answers", "lines", lost_answers),
    Plant("inverted door contact", "contacts", inverted_door),
    Plant("door contact on another input", "contacts", stuck_door),
    Plant("bridged contact of the interlock chain", "contacts", bridged_contact),
    Plant("own limit that does not act", "supplies", own_limit_broken, BOTH),
    Plant("output that stays on", "supplies", output_stays_on, BOTH),
    Plant("probe off centre", "probe", off_centre),
    Plant("pick-up at the drive frequency", "pick_up", picked_up),
    Plant("reversed table sense", "motion", reversed_sense, BOTH),
    Plant("encoder zero off", "motion", zero_off, BOTH),
    Plant("axis leaning", "motion", leaning, BOTH),
    Plant("axes off square", "motion", off_square, BOTH),
    Plant("swapped gyro channels", "motion", swapped_gyros, BOTH),
    Plant("reversed gyro channel", "motion", reversed_gyro, BOTH),
    Plant("reversed stage sense", "stage", reversed_stage),
    Plant("stage encoder zero off", "stage", stage_zero_off),
    Plant("stage axis stage_leaning", "stage", stage_leaning),
    Plant("pulse weight off", "gyro", pulse_weight_off, BOTH),
    Plant("gyro on another channel", "gyro", other_channel, BOTH),
    Plant("chamber that overshoots", "chamber", overshooting),
    Plant("thermometer on the wrong channel", "chamber", wrong_channel, BOTH),
    Plant("gaussmeter's clock off", "clocks", gaussmeter_clock),
    Plant("pulse board's clock off", "gyro", board_clock, BOTH),
)


def plants_of(part: str) -> tuple[Plant, ...]:
    """Return the faults that a part of a commissioning must name."""
    return tuple(one for one in PLANTS if one.part == part)


SHORT: Mapping[str, Mapping[str, Any]] = {
    "coils": {"record": "2 s"},
    "supplies": {"record": "2 s"},
    "probe": {"record": "2 s", "settle": "0.5 s"},
    "pick_up": {"record": "20 s", "every": "1 s"},
    "motion": {"whole_turns": False, "rest": "2 s"},
    "stage": {"readings": 3, "nplc": 1},
    "gyro": {"record": "300 s"},
    "chamber": {"before": "15 min", "after": "40 min"},
}
"""What makes a part's plan short and leaves the naming as it is."""


@dataclass(frozen=True)
class Case:
    """A whole bench that is healthy, or one with a planted fault, or with two."""

    bench: str
    plant: Plant | None = None
    other: Plant | None = None

    @property
    def name(self) -> str:
        """What is tried."""
        plants = [plant.name for plant in (self.plant, self.other) if plant]
        return f"{self.bench} {' and '.join(plants) or 'healthy'}"


def cases() -> Iterator[Case]:
    """Yield each fault on each bench that has what it needs, then the healthy benches."""
    for plant in PLANTS:
        for bench in plant.benches:
            yield Case(bench, plant)
    for bench in BOTH:
        yield Case(bench)


def pair(seed: int) -> Case:
    """Return two faults on one bench, drawn by a seed; none that ends the run at once."""
    lasting = [plant for plant in PLANTS if "sim" in plant.benches and plant.lasts]
    return Case("sim", *random.Random(f"pair {seed}").sample(lasting, 2))


def commission(case: Case, seed: int, folder: Path, *, short: bool = False) -> tuple[bool, Outcome]:
    """Commission a case at a seed; return whether it came out as it should, and how.

    A healthy bench, or one with two faults, as `station commission` does it; a single fault by the
    part that must name it. Of two faults each is named, and nothing else; that a part cannot decide
    its figure because of what another one names is no cause.
    """
    bench = shipped_bench(case.bench)
    bench["simulation"]["seed"] = seed
    if case.plant is None:
        outcome = run_of(folder, bench_plan_of(case.bench), bench)
        return outcome.exit_code == 0 and named(outcome) == set(), outcome
    rng = random.Random(f"{seed} {case.name}")
    expected = case.plant.plant(bench, rng)
    if case.other is not None:
        planted = expected, case.other.plant(bench, rng)
        both = {flag for flag in planted if not isinstance(flag, Ends)}
        plan = bench_plan_of(case.bench)
        for part, brief in SHORT.items() if short else ():
            plan["parameters"].setdefault(part, {}).update(brief)
        outcome = run_of(folder, plan, bench)
        if outcome.document is None:
            # Answers that are lost while a supply proves that it is at rest end the run.
            lines = [f"{flag[1]}: " for flag in both if flag[0] == "line-loses-answers"]
            ended = outcome.exit_code == 3 and any(name in str(outcome.error) for name in lines)
            return ended, outcome
        causes = {flag for flag in named(outcome) if not flag[0].endswith("-undecided")}
        return outcome.exit_code == 1 and causes == both, outcome
    plan = whole_plan_of(case.plant.part, case.bench)
    if short:
        plan["parameters"].setdefault(case.plant.part, {}).update(SHORT.get(case.plant.part, {}))
    outcome = run_of(folder, plan, bench)
    return is_named(outcome, expected), outcome
