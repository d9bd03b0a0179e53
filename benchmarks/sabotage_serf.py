"""Faults planted in coil-angle datasets, and the flags that name them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from sabotage import Fault, Made
from sabotage_serf_changes import (
    KINDS,
    begun,
    bridged,
    cells,
    clean_of,
    clock,
    columns,
    fault,
    held,
    inverted,
    leaking,
    line_V,
    moved,
    one_sense,
    read_again,
    stated,
    stepping,
    volts,
    wandering,
    warped,
)
from scipy.signal import lfilter

SHOTS = "shots-disagree shot-rejected"
STEP = f"{SHOTS} unseen-step"
SHAPE = "misfit model-too-stiff"
SPOILT = f"{SHAPE} {SHOTS} overload outliers-rejected"
DENIED = "contradicts-statement"
XY, XZ, YZ = (1, 4, 7, 10), (2, 5, 8, 11), (3, 6, 9, 12)
X_TURNED, Y_TURNED, Z_TURNED = (-1, 1, 1), (1, -1, 1), (1, 1, -1)
EXCITATION = "wrong-excitation slowing-down-factor-outside"
FACTOR = "slowing-down-factor-outside contradicts-statement"
LEAK = {"relaxation": 330.0, "residual_nT": (0.0, 0.0, 1.0)}

FAULTS: Sequence[Fault] = (
    fault("known coils, x off by 0.3 %", DENIED, cells(factors=(1.003, 1, 1)), "known"),
    fault("known coils, z off by 0.05 %", DENIED, cells(factors=(1, 1, 0.9995)), "known"),
    fault("known coils, y off by 0.02 %", DENIED, cells(factors=(1, 1.0002, 1)), "known"),
    fault("known coils, all off by 1 %", FACTOR, cells(factors=(1.01,) * 3), "known"),
    fault("four shots, x off by 1 %", FACTOR, cells(factors=(1.01, 1, 1)), "four"),
    fault("four shots, residual field", FACTOR, cells(residual_nT=(1.0, 0.5, -0.5)), "four"),
    fault("single shots lost", SHOTS, volts(lambda v, t, d: np.clip(v, -0.1, 0.1), (0, 13))),
    fault(
        "single shots lost, fast exchange",
        SHOTS,
        volts(lambda v, t, d: 0 * v, (0, 13)),
        "fast exchange",
    ),
    fault("a commanded sign is wrong", SHOTS, stated({5: (1, 1, -1)}), shows=True),
    fault("a commanded field is 1 % off", SHOTS, stated({5: (1.01, 1, 1.01)}), shows=True),
    fault("a commanded field is 0.1 % off", SHOTS, stated({2: (1.001, 1.001, 1)}), shows=True),
    fault("a commanded field is a tenth", SHOTS, stated({8: (1, 1, 0.1)}), shows=True),
    fault("the single field is 0.2 % off", SHOTS, stated({0: (1.002, 1, 1)}), shows=True),
    fault("two polarities exchanged", SHOTS, columns({1: 4, 4: 1})),
    fault("opposite polarities exchanged", SHOTS, columns({1: 10, 10: 1})),
    fault("pairs exchanged", SHOTS, columns({1: 2, 2: 1})),
    fault(
        "all xy and xz exchanged",
        SHOTS,
        columns({1: 2, 2: 1, 4: 5, 5: 4, 7: 8, 8: 7, 10: 11, 11: 10}),
    ),
    fault("a column copied", SHOTS, columns({4: 1})),
    fault("a column copied, like polarity", SHOTS, columns({10: 1})),
    fault(
        "residual field steps",
        SHOTS,
        wandering(lambda k: (0, 0.03 * (k % 4 > 1), 0), "residual_nT"),
    ),
    fault("residual field drifts", SHOTS, wandering(lambda k: (0, 0, 0.005 * k), "residual_nT")),
    fault(
        "all fields drift by 0.1 %", SHOTS, wandering(lambda k: (1e-4 * (k % 5),) * 3, "factors")
    ),
    fault(
        "nuclei precess",
        SHOTS,
        wandering(lambda k: (0.4 * np.cos(k), 0.4 * np.sin(k), 0), "residual_nT"),
    ),
    fault("pump leaks in three shots", SHOTS, cells((3, 7, 9), **LEAK)),
    fault("light shift in one shot", SHOTS, cells((3,), residual_nT=(0, 0, 1.0))),
    fault("supplies sag in pairs", SHOTS, cells(range(1, 13), factors=(0.997,) * 3)),
    fault("pick-up 50 Hz not stated", SPOILT, line_V(0.03, 50.0)),
    fault("pick-up 60 Hz stated as 50", SPOILT, line_V(0.03, 60.0), "mains"),
    fault("pick-up beside the tone", SPOILT, line_V(0.02, 210.0)),
    fault("pick-up of a switched supply", SPOILT, line_V(0.05, 1234.0)),
    fault("field has 50 Hz on it", SPOILT, warped(lambda t, b: 3e-5 * np.sin(314.16 * t))),
    fault("coil current rises", SPOILT, warped(lambda t, b: -5e-4 * (1 - np.exp(-t / 5e-4)))),
    fault(
        "coil current rises slowly", SPOILT, warped(lambda t, b: -2e-4 * (1 - np.exp(-t / 2e-2)))
    ),
    fault("field droops", SPOILT, warped(lambda t, b: -0.05 * t**2)),
    fault("field droops in one shot", SPOILT, warped(lambda t, b: -0.05 * t**2, (4,))),
    fault("field rises in the end", SPOILT, warped(lambda t, b: 0.05 * t**2)),
    fault(
        "field steps within a shot",
        SPOILT,
        warped(lambda t, b: 0.004 * np.maximum(t - 0.015, 0), (6,)),
    ),
    fault("light goes off late", SPOILT, volts(lambda v, t, d: v + 0.3 * np.exp(-t / 1.5e-3))),
    fault("rows lost unseen", SPOILT, warped(lambda t, b: 1e-3 * (t > 0.012))),
    fault("rows lost unseen, few", SPOILT, warped(lambda t, b: 2e-4 * (t > 0.012))),
    fault("rows repeated unseen", SPOILT, warped(lambda t, b: -1e-3 * (t > 0.012))),
    fault("rows lost in one shot", SPOILT, warped(lambda t, b: 5e-4 * (t > 0.012), (5,))),
    fault("a block copied", SPOILT, volts(lambda v, t, d: moved(v, 150, 100, 40), (5,))),
    fault("recorder stands still", SPOILT, volts(lambda v, t, d: held(v, 120, 30), (2, 5))),
    fault("gaps filled straight", SPOILT, volts(lambda v, t, d: bridged(v, 130, 40))),
    fault("clipped on one side", SPOILT, volts(lambda v, t, d: np.minimum(v, 0.5))),
    fault("detector compresses", SPOILT, volts(lambda v, t, d: np.tanh(v))),
    fault("detector bends", SPOILT, volts(lambda v, t, d: v + 0.1 * v**2)),
    fault(
        "burst of noise",
        SPOILT,
        volts(lambda v, t, d: v + 0.3 * d.standard_normal(len(v)) * (abs(t - 0.01) < 3e-3)),
    ),
    fault("spikes", SPOILT, volts(lambda v, t, d: v + 0.5 * (d.random(len(v)) < 0.03))),
    fault(
        "coupled by a capacitor", SPOILT, volts(lambda v, t, d: lfilter([1, -1], [1, -0.995], v))
    ),
    fault("filtered", SPOILT, volts(lambda v, t, d: lfilter(np.ones(8) / 8, 1, v))),
    fault(
        "every second sample made up", SPOILT, volts(lambda v, t, d: np.interp(t, t[::2], v[::2]))
    ),
    fault("few bits", SPOILT, volts(lambda v, t, d: np.round(v / 0.125) * 0.125)),
    fault("detector drifts", SPOILT, volts(lambda v, t, d: v + 2.0 * t)),
    fault("detector settles", SPOILT, volts(lambda v, t, d: v + 0.2 * np.exp(-t / 8e-3))),
    fault(
        "another shot shines through",
        SPOILT,
        lambda one, d: replace(one, volts=one.volts + 0.03 * one.volts[[0]]),
    ),
    fault(
        "signal grows weak in mid-shot",
        SPOILT,
        volts(lambda v, t, d: v * np.where(t > 0.012, 0.8, 1.0)),
    ),
    fault("noise alone", SPOILT, volts(lambda v, t, d: 0.01 * d.standard_normal(len(v)), (3,))),
    fault("one recorder's clock is off", SHOTS, warped(lambda t, b: 1e-3 * t, (7,))),
    fault("stamps 0.5 % too fast", DENIED, clock(1.005), "known", True),
    fault("both clocks 0.5 % off", FACTOR, warped(lambda t, b: 5e-3 * t), "known"),
    fault("gyromagnetic ratio off", FACTOR, stated(gyromagnetic_ratio="27.9 Hz/nT"), "known", True),
    fault("wrong isotope", FACTOR, stated(nuclear_spin=2.5), shows=True),
    fault(
        "pump and probe exchanged", FACTOR, stated(pump_axis="y", probe_axis="z"), "strong", True
    ),
    fault("a shot pumped less", SPOILT, cells((4,), polarisation=0.45), "strong"),
    fault("pumping wears off", SPOILT, wandering(lambda k: -0.005 * k, "polarisation"), "strong"),
    fault("a record begins late", SPOILT, cells((4, 9), delay_s=8e-4), "strong"),
    fault("output inverted in half the shots", DENIED, inverted(range(0, 14, 2)), "strong"),
    fault("output inverted for the first half", DENIED, inverted(range(7)), "strong"),
    fault("coil x the other way in pairs xy", DENIED, stated(dict.fromkeys(XY, X_TURNED))),
    fault("field droops while it chirps", SPOILT, warped(lambda t, b: -0.05 * t**2), "strong"),
    fault("coil y the other way in pairs xy", DENIED, stated(dict.fromkeys(XY, Y_TURNED))),
    fault("coil z the other way in pairs xz", DENIED, stated(dict.fromkeys(XZ, Z_TURNED))),
    fault("coil z the other way, strong", SHOTS, stated(dict.fromkeys(YZ, Z_TURNED)), "strong"),
    fault("pairs xy taken with the coils xz", DENIED, columns(dict(zip(XY, XZ, strict=True)))),
    fault("pairs xz and yz exchanged", DENIED, columns(dict(zip(XZ + YZ, YZ + XZ, strict=True)))),
    fault("supply x does not reverse", DENIED, one_sense(0)),
    fault("supply z does not reverse", DENIED, one_sense(2)),
    fault("coil y twice its field in pairs xy", SHOTS, stated(dict.fromkeys(XY, (1, 2, 1)))),
    fault("a record read again", SHOTS, read_again({4: 1})),
    fault("a record read again, strong", SHOTS, read_again({5: 4}), "strong"),
    fault("fields in pT", EXCITATION, stated(dict.fromkeys(range(14), (1e3,) * 3)), shows=True),
    fault(
        "fields grow by 0.5 % in mid-course",
        SHOTS,
        wandering(lambda k: (0.005 * (k > 6),) * 3, "factors"),
    ),
    fault("clock of the last seven is off", SHOTS, warped(lambda t, b: 1e-3 * t, range(7, 14))),
    fault("stamps begin at 1 s", DENIED, begun(1.0), shows=True),
    fault("stamps begin at 20 ms", SPOILT, begun(0.02), "strong", True),
    fault("the cell warms", SPOILT, wandering(lambda k: 8.0 * k, "relaxation"), "strong"),
    fault("the vapour grows denser", SPOILT, wandering(lambda k: 2e4 * k, "exchange"), "strong"),
    *(
        fault(
            f"residual field steps along {axis} before shot {place}, {kind}",
            STEP,
            stepping(place, axis, size_nT),
            kind,
        )
        for kind, size_nT in (("opposites", 0.3), ("blocks", 0.3), ("few cycles", 0.5))
        for place in (4, 7, 8, 10)
        for axis in "xyz"
    ),
    *(
        fault("residual field steps in mid-course", STEP, stepping(7, "z", 0.3), kind, True)
        for kind in ("reversal", "known", "strong", "mains")
    ),
    *(
        fault(f"coil {coil} leaks into {into} in one sense", SHOTS, leaking(coil, into, 0.2), kind)
        for kind in ("reversal", "few cycles", "caesium")
        for coil, into in ("xy", "xz", "yz", "zx")
    ),
)

CLEAN: Sequence[Callable[[int], Made]] = tuple(partial(clean_of, kind) for kind in KINDS)
USUAL_FLAGS = frozenset(
    {"scale-by-convention", "chirp", "few-cycles", "not-identifiable", "unseen-step"}
)
