"""`station commission`: the commissioning plan on a bench, fitted to what its probe can see."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from station import registry
from station.cli.running import run_plan
from station.cli.validating import read_bench_named
from station.instruments.bench import Bench

TURN_PROBE = "parameters.turn_probe"


def commission_bench(
    bench_name: str,
    overrides: Sequence[str],
    non_interactive: bool,
    answers: Path | None,
    output: Path,
    *,
    as_json: bool,
) -> int:
    """Run the shipped plan on a bench and return the exit code of the run.

    A probe of one axis is turned, unless an override states otherwise.
    """
    turned = turning(read_bench_named(bench_name), overrides)
    return run_plan(
        "commissioning",
        bench_name,
        non_interactive=non_interactive,
        answers=answers,
        served=None,
        output=output,
        as_json=as_json,
        overrides=(*turned, *overrides),
    )


def turning(bench: Bench, overrides: Sequence[str]) -> tuple[str, ...]:
    """Return the override that has a probe of one axis turned, where nothing else is stated."""
    gaussmeter = bench.instruments.get("gaussmeter")
    if gaussmeter is None or registry.why_not(registry.DRIVERS, gaussmeter.driver):
        return ()
    if any(one.startswith(f"{TURN_PROBE}=") for one in overrides):
        return ()
    driver = registry.load(registry.DRIVERS, gaussmeter.driver)
    return (f"{TURN_PROBE}=true",) if driver.axes == 1 else ()
