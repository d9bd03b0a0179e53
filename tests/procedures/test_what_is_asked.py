"""What a person is asked to do before a run of a shipped plan measures, and between."""

from __future__ import annotations

import pytest
from shipped import shipped_bench

from station.cli.validating import read_plan_for
from station.procedure import procedure_of

TURNTABLE = ("mount-X-up", "connect-cables", "mount-Y-up", "mount-Z-up")
NAVIGATOR = ("navigator-X-up", "connect-cables", "navigator-Y-up")
ASKED = {
    "rlg-magnetic-sensitivity": ("mount", "connect-cables"),
    "accelerometer-magnetic-sensitivity": ("connect-cables", "mount-io", "mount-ip"),
    "fog-scale-factor-temperature": ("mount", "connect-cables"),
    "nine-axis-calibration": ("mount-table",),
    "gyro-static-noise": ("mount", "connect-cables"),
    "gyro-static-noise-navigator": (*NAVIGATOR, "navigator-Z-down"),
    "gyro-rate-table": ("mount-gyro-on-table", "connect-cables"),
    "gyro-rate-table-imu": TURNTABLE,
    "gyro-rate-table-navigator": (*NAVIGATOR, "navigator-Z-up"),
    "gyro-bias-temperature": ("mount-in-chamber", "connect-cables"),
}


@pytest.mark.parametrize("name", ASKED)
def test_a_run_asks_for_each_mounting_once_and_for_cables(name: str) -> None:
    plan = read_plan_for(name, shipped_bench(), ())
    asked = [prompt.id for prompt in procedure_of(plan.procedure).walk(plan.parameters).prompts]
    assert tuple(asked) == ASKED[name]
