"""What a plan determines, and how well, before anything moves; and why a bench does not fit it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from station import registry
from station.method.cell_commands import SURE_OF_DARK, coil_voltage_V, constant_of
from station.procedure import Problem, RecordUse
from station.report.numbers import format_number
from station.units import parse_as

from .cell import CHANNELS, DIGITIZER, FIELD, PUMP
from .oven import HEATER, cell_record
from .parameters import SerfParameters
from .shots import AXES, MIN_CYCLES, PAIRS

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.roles import Digitizer

SIGNAL_TO_NOISE = 100.0
"""Of a single sample of the first shot; what the uncertainties below hold for."""
FULL_RECORD = 3.0
ARCSEC = math.pi / 648000.0
MIN_LOSS_SHARE = 0.5
"""Broadening over width at which angles are determined best."""
OVERSAMPLING = 4.0
TONE_FREQUENCY = ("parameters", "nulling", "frequency")
MIN_TONE_SAMPLES = 40.0
"""Of each cycle of a tone, for its lines."""
MIN_DECAYS, USUAL_DECAYS = 1.0, 3.0
BEYOND_USE = 3.0
"""Loss against the best field, as a ratio of uncertainties, beyond which a plan is refused."""


@dataclass(frozen=True)
class Expectation:
    """What the cell's rates and the plan's fields lead to.

    `frequency_Hz`, `decay_per_s` and `cycles` within the 1/e time by shot (coils driven);
    `broadening_share` is the largest broadening over the width without a field, `loss` by how much
    the uncertainty of an angle is larger than at the best field, `record_decays` how many 1/e times
    of the slowest line the record holds.
    """

    frequency_Hz: Mapping[str, float]
    decay_per_s: Mapping[str, float]
    cycles: Mapping[str, float]
    broadening_share: float
    loss: float
    record_decays: float


def expectation(parameters: SerfParameters) -> Expectation | None:
    """Return what a plan leads to, None where it does not give the cell's rates."""
    relaxation, exchange = parameters.relaxation_rate_Hz, parameters.exchange_rate_Hz
    if relaxation is None or exchange is None:
        return None
    q = parameters.slowing_down.at_rest
    width = relaxation / q
    beta = parameters.slowing_down.broadening / exchange
    frequency, decay, cycles = {}, {}, {}
    for shot in parameters.wanted:
        hertz = parameters.gyromagnetic_ratio_Hz_per_nT * math.hypot(*shot.field_nT) / q
        frequency[shot.coils] = hertz
        decay[shot.coils] = width + beta * (2.0 * math.pi * hertz) ** 2
        cycles[shot.coils] = hertz / decay[shot.coils]
    fastest = 2.0 * math.pi * max(frequency.values())
    share = beta * fastest**2 / width
    return Expectation(
        frequency,
        decay,
        cycles,
        share,
        _relative_u(share) / _relative_u(MIN_LOSS_SHARE),
        parameters.record_s * min(decay.values()),
    )


def _relative_u(share: float) -> float:
    """Return the uncertainty of a frequency over it, on a scale, from broadening over width.

    It goes as decay^1.5 / w, as of any damped tone in white noise.
    """
    return math.sqrt((1.0 + share) ** 3 / share)


def outlook(parameters: SerfParameters) -> tuple[str, ...]:
    """Return in lines what a plan determines, what it does not, and how well."""
    import numpy as np

    from .angles import NAMES, solve

    field = ", ".join(f"{axis} {b:g} nT" for axis, b in parameters.field_levels_nT.items())
    lines = [f"{len(parameters.wanted)} shots, {field}."]
    rule = parameters.nulling
    if rule.method == "modulation":
        lines.append(
            f"Nulled by modulation: tones of {rule.tone_nT:g} nT at {rule.frequency_Hz:g} Hz on "
            f"each coil in turn, {rule.bias_nT:g} nT to either side of zero."
        )
    if parameters.shots == "as_published":
        lines.append(
            "The residual field is taken for zero and the coil constants for exact: at these "
            f"fields 1 nT moves an angle by up to {_by_residual(parameters):.2g} deg, 1 % of a "
            "coil constant by up to 1.2 deg. `shots: reversal` is free of both."
        )
    else:
        lines.append("Angles, residual field and coil factors are determined.")
    expected = expectation(parameters)
    if expected is None:
        lines.append("Give relaxation_rate and exchange_rate for expected uncertainties.")
        return tuple(lines)
    frequency = np.array([expected.frequency_Hz[shot.coils] for shot in parameters.wanted])
    decay = np.array([expected.decay_per_s[shot.coils] for shot in parameters.wanted])
    amplitude = np.array([_amplitude(shot.coils, parameters) for shot in parameters.wanted])
    u = 4.0 * decay**1.5 / (SIGNAL_TO_NOISE * amplitude * math.sqrt(parameters.sample_rate_Hz))
    known = parameters.shots == "as_published" or parameters.coil_constants == "known"
    commanded_nT = np.array([shot.field_nT for shot in parameters.wanted])
    solution = solve(commanded_nT, 2.0 * np.pi * frequency, np.diag(u**2), known=known)
    size = np.sqrt(np.diag(solution.covariance))
    uncertainties = ", ".join(
        f"{pair} {format_number(float(size[NAMES.index(pair)]) / ARCSEC, 2)} arcsec"
        for pair in PAIRS
    )
    lines.append(
        f"u from noise, at {SIGNAL_TO_NOISE:g} times the noise of a sample: {uncertainties} "
        f"({expected.loss:.2f} times those at the best field, {parameters.best_field_nT:g} nT)."
    )
    slow = min(expected.cycles, key=lambda coils: expected.cycles[coils])
    lines.append(
        f"Precession {min(expected.frequency_Hz.values()):.0f} Hz to "
        f"{max(expected.frequency_Hz.values()):.0f} Hz; at least "
        f"{expected.cycles[slow]:.1f} cycles within the 1/e time ({slow})."
    )
    if expected.record_decays < FULL_RECORD:
        lines.append(
            f"A record holds {expected.record_decays:.1f} 1/e times: "
            f"{FULL_RECORD / expected.record_decays * parameters.record_s:.2g} s would be better."
        )
    return tuple(lines)


def _amplitude(coils: str, parameters: SerfParameters) -> float:
    """Return which part of the largest signal a shot has: sines of field to pump and to probe."""
    share = 1.0 / len(coils)
    beside_pump = 1.0 - (share if parameters.pump_axis in coils else 0.0)
    beside_probe = 1.0 - (share if parameters.probe_axis in coils else 0.0)
    return math.sqrt(beside_pump * beside_probe)


def _by_residual(parameters: SerfParameters) -> float:
    """Return by how many degrees a nanotesla may move an angle of the published shots."""
    return math.degrees(2.0 / min(parameters.field_levels_nT.values()))


def records(parameters: SerfParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records.

    The coil constants count only where they are taken for known: else each coil has a factor.
    """
    generators = dict.fromkeys(CHANNELS[coil][0] for coil in AXES)
    degC = parameters.cell_temperature_degC
    cell = [] if degC is None else [RecordUse(HEATER, *cell_record(degC), needed=False)]
    coils = [RecordUse(generator, "scale", 1.0, "1") for generator in generators]
    return (
        *(coils if parameters.constants_known else ()),
        RecordUse(DIGITIZER, "frequency", parameters.sample_rate_Hz, "Hz"),
        RecordUse(PUMP, "time_offset", 0.0, "s", needed=False, corrected=False),
        *cell,
    )


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
    yield from _tones(parameters, bench)
    expected = expectation(parameters)
    if expected is None:
        return
    if expected.record_decays < MIN_DECAYS:
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
    elif cycles < MIN_CYCLES:
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


def _tones(parameters: SerfParameters, bench: Bench) -> Iterator[Problem]:
    """Yield why tones cannot be recorded, or their lines not be told from others."""
    rule, rate_Hz, mains_Hz = (
        parameters.nulling,
        parameters.tone_rate_Hz,
        parameters.mains_frequency_Hz,
    )
    if rule.method != "modulation" or not rule.rounds:
        return
    if rate_Hz < MIN_TONE_SAMPLES * rule.frequency_Hz:
        yield Problem(
            TONE_FREQUENCY,
            f"{rate_Hz:g} Hz samples a cycle fewer than {MIN_TONE_SAMPLES:g} times; "
            f"{rate_Hz / MIN_TONE_SAMPLES:.3g} Hz would do",
        )
    if mains_Hz is not None:
        apart_Hz = abs(mains_Hz - rule.frequency_Hz * round(mains_Hz / rule.frequency_Hz))
        if apart_Hz < rule.frequency_Hz / rule.cycles:
            yield Problem(
                TONE_FREQUENCY,
                f"a multiple of {rule.frequency_Hz:g} Hz lies {apart_Hz:.2g} Hz from the mains, "
                f"{mains_Hz:g} Hz, which {rule.cycles} cycles do not tell apart; take another "
                "frequency, or more cycles",
            )
    digitizer = bench.instruments.get(DIGITIZER)
    if digitizer is None:
        return
    driver: type[Digitizer] = registry.load(registry.DRIVERS, digitizer.driver)
    why = driver.why_no_record(digitizer.settings, rate_Hz, rule.record_s, parameters.full_scale_V)
    if why is not None:
        yield Problem(
            ("parameters", "nulling", "cycles"),
            f"{DIGITIZER} cannot record {rule.record_s:.3g} s at {rate_Hz:g} Hz up to "
            f"{parameters.full_scale_V:g} V: {why}",
        )


def _constants(bench: Bench) -> Iterator[Problem]:
    """Yield each coil whose constant the bench file does not give, or gives wrongly."""
    for coil, (generator, _) in CHANNELS.items():
        known = generator not in bench.instruments
        if known or math.isfinite(coil_voltage_V(bench, generator, coil, 1.0)):
            continue
        key, unit = constant_of(coil)
        yield Problem(
            ("procedure",),
            f"the bench {bench.name!r} does not say what a volt makes at the coil {coil}: "
            f"give settings.{key} of {generator}, such as 20 {unit}",
        )
