"""Why a plan cannot run on a bench; nothing is energised to find out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from station import registry
from station.procedure import Problem
from station.units import UnitError, parse_as

from .cell import CHANNELS, DIGITIZER, PUMP, SURE_OF_DARK
from .expected import expectation
from .parameters import SerfParameters
from .shots import LEAST_CYCLES

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.roles import Digitizer

FIELD = ("parameters", "field")
OVERSAMPLING = 4.0
LEAST_DECAYS, USUAL_DECAYS = 1.0, 3.0
BEYOND_USE = 3.0
"""Loss against the best field, as a ratio of uncertainties, beyond which a plan is refused."""


def check(parameters: SerfParameters, bench: Bench) -> Iterator[Problem]:
    """Yield what of the plan no cell or no generator of this bench could do."""
    yield from _constants(bench)
    fastest_Hz = parameters.fastest_precession_Hz
    if parameters.sample_rate_Hz < OVERSAMPLING * fastest_Hz:
        yield Problem(
            ("parameters", "sample_rate"),
            f"{parameters.sample_rate_Hz:g} Hz is less than four times the fastest precession to "
            f"be expected, {fastest_Hz:.0f} Hz; {OVERSAMPLING * fastest_Hz:.0f} Hz would do",
        )
    yield from _recorder(parameters, bench)
    expected = expectation(parameters)
    if expected is None:
        return
    if expected.record_decays < LEAST_DECAYS:
        yield Problem(
            ("parameters", "record"),
            f"it holds {expected.record_decays:.2g} 1/e times of the slowest precession, fewer "
            f"than one; {USUAL_DECAYS / expected.record_decays * parameters.record_s:.2g} s would "
            "do",
        )
    cycles = min(expected.cycles.values())
    best_nT = parameters.best_field_nT
    if expected.loss > BEYOND_USE and expected.broadening_share > 0.5:
        yield Problem(
            FIELD,
            f"spin exchange broadens the lines to {1.0 + expected.broadening_share:.1f} times "
            f"their width, angles are known {expected.loss:.1f} times less well than at best; take "
            f"about {best_nT:g} nT",
        )
    elif cycles < LEAST_CYCLES:
        yield Problem(
            FIELD,
            f"{cycles:.2f} cycles pass within the 1/e time, fewer than one; take about "
            f"{best_nT:g} nT",
        )


def _recorder(parameters: SerfParameters, bench: Bench) -> Iterator[Problem]:
    """Yield why the digitizer cannot take the record, or nobody knows when it may begin."""
    digitizer, pump = (bench.instruments.get(name) for name in (DIGITIZER, PUMP))
    if digitizer is None or pump is None:
        return
    dark = pump.settings.get("trigger_to_dark")
    if dark is None:
        yield Problem(
            ("procedure",),
            f"the bench {bench.name!r} does not say when the light is off: measure it with a "
            f"photodiode and give settings.trigger_to_dark of {PUMP}, such as 8 ms",
        )
        return
    driver: type[Digitizer] = registry.load(registry.DRIVERS, digitizer.driver)
    duration_s = parameters.record_s + SURE_OF_DARK * parse_as(str(dark), "s")
    why = driver.why_no_record(
        digitizer.settings, parameters.sample_rate_Hz, duration_s, parameters.full_scale_V
    )
    if why is not None:
        yield Problem(
            ("parameters", "record"),
            f"{DIGITIZER} cannot record {duration_s:.3g} s at {parameters.sample_rate_Hz:g} Hz up "
            f"to {parameters.full_scale_V:g} V: {why}",
        )


def _constants(bench: Bench) -> Iterator[Problem]:
    """Yield each coil whose constant the bench file does not give, or gives wrongly."""
    for coil, (generator, _) in CHANNELS.items():
        instrument = bench.instruments.get(generator)
        if instrument is None:
            continue
        key, unit = f"constant_{coil}", "nT/V"
        if coil == "gradient":
            key, unit = "gradient_at_1_V", "nT/cm"
        try:
            value = parse_as(str(instrument.settings[key]), unit)
            fine = math.isfinite(value) and value > 0.0
        except (KeyError, UnitError):
            fine = False
        if not fine:
            yield Problem(
                ("procedure",),
                f"the bench {bench.name!r} does not say what a volt makes at the coil {coil}: "
                f"give settings.{key} of {generator}, such as 20 {unit}",
            )


def knows_its_coils(bench: Bench) -> bool:
    """Tell whether the bench file gives the constants of all coils."""
    return not list(_constants(bench))
