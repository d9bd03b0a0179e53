"""The shipped plans in the short form that campaigns of many runs walk through."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from commissioning_parts import only
from quick_yaml import load_yaml

from station import registry
from station.cli.validating import read_plan_for
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import Plan
from station.instruments.bench import Bench, read_bench

SHORT_FORMS: Mapping[str, tuple[str, ...]] = {
    "rlg-magnetic-sensitivity": (
        "parameters.frequency=0.2 Hz",
        "parameters.duration=50 s",
        "parameters.axes=[IA, NA]",
        "parameters.undriven_sensitivity=0.1 deg/h/mT",
        "parameters.settle=5 s",
        "parameters.warm_up.slope_limit=40 deg/h^2",
        "parameters.warm_up.window=30 s",
        "parameters.warm_up.at_most=5 min",
    ),
    "rlg-magnetic-sensitivity-simultaneous": (
        "parameters.duration=100 s",
        "parameters.stop.uncertainty=0.008 deg/h/mT",
        "parameters.stop.at_most=150 s",
        "parameters.checks=[background]",
        "parameters.settle=5 s",
        "parameters.warm_up.slope_limit=40 deg/h^2",
        "parameters.warm_up.window=30 s",
        "parameters.warm_up.at_most=5 min",
    ),
    "accelerometer-magnetic-sensitivity": (
        "parameters.planes=[io]",
        "parameters.field_step=50 mT",
        "parameters.angle_step=30 deg",
        "parameters.order=as_published",
        "parameters.repeats=1",
        "parameters.readings=2",
        "parameters.nplc=1",
        "parameters.warm_up=30 s",
    ),
    "accelerometer-tumble": (
        "parameters.mountings=[io, io-reversed, ip]",
        "parameters.positions=8",
        "parameters.dwell=1 s",
        "parameters.readings=2",
        "parameters.nplc=1",
        "parameters.warm_up=30 s",
    ),
    "serf-nonorthogonality": (
        "parameters.record=60 ms",
        "parameters.depolarise.duration=2 s",
        "parameters.nulling.rounds=1",
        "parameters.heating_rate=20 degC/min",
        "parameters.stability.duration=20 s",
    ),
    "fog-scale-factor-temperature": (
        "parameters.outside_published_range=true",
        "parameters.temperature_range=[22 degC, 24 degC]",
        "parameters.reference_temperature=23.5 degC",
        "parameters.soak=1 min",
        "parameters.ramp_rate=120 degC/h",
        "parameters.set_interval=1 min",
        "parameters.axes=[x]",
        "parameters.turn_rate=90 deg/s",
        "parameters.turn_acceleration=50 deg/s^2",
        "parameters.settle=3 s",
        "parameters.reorientation=20 s",
        "parameters.random_rotation=10 s",
        "parameters.chamber_at_most=14 min",
        "parameters.initial_order=1",
        "parameters.asked_uncertainty=null",
        "parameters.verification.ramp_rate=120 degC/h",
        "parameters.warm_up.slope_limit=200 degC/h",
        "parameters.warm_up.window=1 min",
    ),
    "nine-axis-calibration": (
        "parameters.warm_up=5 min",
        "parameters.static_time=60 s",
        "parameters.static_settle=2 s",
        "parameters.settle=1 s",
        "parameters.sample_rate=10 Hz",
        "parameters.rates=[20 deg/s, 40 deg/s, 60 deg/s, 80 deg/s, 100 deg/s]",
    ),
    "nine-axis-calibration-coil": (
        "parameters.warm_up=5 min",
        "parameters.static_time=60 s",
        "parameters.static_settle=2 s",
        "parameters.settle=1 s",
        "parameters.sample_rate=10 Hz",
        "parameters.rates=[20 deg/s, 40 deg/s, 60 deg/s, 80 deg/s, 100 deg/s]",
        "parameters.magnetometer_in_coil.levels=[60 uT]",
        "parameters.magnetometer_in_coil.record=5 s",
    ),
    "gyro-static-noise": (
        "parameters.warm_up=1 min",
        "parameters.record=4 min",
        "parameters.repeats=1",
        "parameters.repeat_record=1 min",
        "parameters.cool=1 min",
        "limits.bias_repeatability=null",
    ),
    "gyro-static-noise-imu": (
        "parameters.warm_up=1 min",
        "parameters.record=4 min",
        "parameters.repeats=1",
        "parameters.repeat_record=1 min",
        "parameters.cool=1 min",
        "limits.angle_random_walk.max=0.1 deg/sqrt(h)",
        "limits.bias_repeatability=null",
    ),
    "gyro-static-noise-navigator": (
        "parameters.warm_up=10 min",
        "parameters.record=4 min",
        "parameters.repeats=1",
        "parameters.repeat_record=1 min",
        "parameters.cool=1 min",
        "limits.angle_random_walk.max=0.1 deg/sqrt(h)",
    ),
    "gyro-rate-table": (
        "parameters.rates=[50 deg/s, 100 deg/s]",
        "parameters.record=20 s",
        "parameters.stand=15 s",
        "parameters.settle=1 s",
        "parameters.switch_ons=2",
        "parameters.warm_up=1 min",
        "parameters.cool=1 min",
    ),
    "gyro-bias-temperature": (
        "parameters.row_interval=10 s",
        "parameters.warm_up=2 min",
        "parameters.soaks=[16 degC, 30 degC]",
        "parameters.soak=5 min",
        "parameters.ramp_up=3 degC/min",
        "parameters.ramp_down=2 degC/min",
        "parameters.chamber_interval=5 s",
        "parameters.soaked_within=8 degC",
        "parameters.reference_temperature=24 degC",
        "limits.bias_temperature_sensitivity=null",
    ),
    "gyro-rate-table-imu": (
        "parameters.rates=[50 deg/s, 100 deg/s]",
        "parameters.record=20 s",
        "parameters.stand=15 s",
        "parameters.settle=1 s",
        "parameters.switch_ons=2",
        "parameters.warm_up=1 min",
        "parameters.cool=1 min",
        "parameters.axes=[X, Z]",
        "limits.scale_factor_repeatability=null",
        "limits.nonlinearity_of_full_scale=null",
    ),
    "gyro-rate-table-navigator": (
        "parameters.rates=[50 deg/s, 100 deg/s]",
        "parameters.record=20 s",
        "parameters.stand=15 s",
        "parameters.settle=1 s",
        "parameters.switch_ons=2",
        "parameters.warm_up=10 min",
        "parameters.cool=1 min",
        "parameters.axes=[X, Z]",
        "limits.scale_factor_repeatability=null",
        "limits.nonlinearity_of_full_scale=null",
    ),
    "commissioning": only("coils"),
}
"""What makes a plan short, by its name; without an entry it runs as it is shipped. A variant of a
procedure's plan joins the campaign by an entry."""
BENCH = "sim"


def bench_data(bench: str = BENCH) -> dict[str, Any]:
    """Return the data of a simulated bench."""
    data: dict[str, Any] = load_yaml(find(BENCHES, bench).read_text(encoding="utf-8"))
    return data


def read_bench_at(path: Path) -> Bench:
    """Return the bench of a file."""
    return read_bench(path, registry.names(registry.DRIVERS))


def short(plan: str, bench: Bench) -> Plan:
    """Return a shipped plan in its short form; raises FaultList where it cannot run."""
    name = load_yaml(find(PLANS, plan).read_text(encoding="utf-8")).get("procedure", "")
    return read_plan_for(plan, bench, SHORT_FORMS.get(plan, SHORT_FORMS.get(str(name), ())))
