"""Which shipped plan runs on which shipped bench; every other is refused by what it lacks."""

from __future__ import annotations

import pytest
from places import CONFIG

from station.cli.validating import read_bench_named, read_plan_for
from station.files.faults import FaultList
from station.method.set_points import checks_of
from station.procedure import procedure_of
from station.roles.role import role_of, roles

PLANS = sorted(path.stem for path in (CONFIG / "plans").glob("*.yaml"))
ONE_AXIS = r"the gaussmeter \(lakeshore-425\) measures one axis at a time"
NO_GENERATOR = (
    "the bench 'sim-alternate' has no signal_generator.(xy|z_gradient), which this plan needs"
)
REFUSED = {
    "commissioning": NO_GENERATOR,
    "nine-axis-calibration-coil": "the gaussmeter of this bench reads one axis",
    "rlg-magnetic-sensitivity-go-no-go": ONE_AXIS,
    "rlg-magnetic-sensitivity-simultaneous": ONE_AXIS,
    "serf-nonorthogonality": NO_GENERATOR,
}
"""On the bench of second models, of which some roles have none."""


@pytest.mark.parametrize("name", PLANS)
def test_a_plan_runs_where_its_roles_are_and_is_refused_by_the_one_that_is_missing(
    name: str,
) -> None:
    read_plan_for(name, read_bench_named("sim"))
    alternate = read_bench_named("sim-alternate")
    if name in REFUSED:
        with pytest.raises(FaultList, match=REFUSED[name]):
            read_plan_for(name, alternate)
    else:
        read_plan_for(name, alternate)


@pytest.mark.parametrize("name", PLANS)
def test_whatever_limit_a_plan_is_held_against_its_role_declares(name: str) -> None:
    """A bench may give no other: nothing would hold it."""
    bench = read_bench_named("sim")
    plan = read_plan_for(name, bench)
    for point in procedure_of(plan.procedure).forecast(plan.parameters, bench).set_points:
        declared = roles()[role_of(point.instrument)].limits
        for check in checks_of(point.instrument):
            if check.value(point, 1.0) is not None:
                assert check.limit in declared, (point.instrument, check.limit)
