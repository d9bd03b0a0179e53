"""Which other reading of a dataset suits, and how seldom chance makes one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.readings import (
    BY_CHANCE,
    DEG_PER_H,
    Reading,
    Remainder,
    exchanged,
    named,
    scaled,
    shifted,
    suiting,
    units,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """An output that follows an input by 2, and another by 3."""

    first: Array
    second: Array
    output: Array


def made(rng: np.random.Generator) -> Line:
    first, second = rng.standard_normal((2, 30))
    output = 2.0 * first + 3.0 * second + 0.01 * rng.standard_normal(30)
    return Line(first, second, output)


def remainder(line: Line) -> Remainder:
    rest = line.output - 2.0 * line.first - 3.0 * line.second
    return Remainder(float(rest @ rest), len(rest))


KINDS = (
    [
        *(Reading(f"{name} is reversed", scaled([name], -1.0), name) for name in ("first",)),
        *units("second", ["second"], {"per cent": 0.01}),
    ],
    [Reading("first and second are exchanged", exchanged("first", "second"), "first")],
    [Reading("output stands a row late", shifted(["output"], 1), "output", {"rows": 1})],
)


def test_each_mix_up_is_named_and_no_other() -> None:
    line = made(np.random.default_rng(1))
    late = Line(line.first, line.second, np.append(line.output[:1], line.output[:-1]))
    mixed = {
        "first is reversed": scaled(["first"], -1.0)(line),
        "second is in per cent": scaled(["second"], 100.0)(line),
        "first and second are exchanged": exchanged("first", "second")(line),
    }
    for what, data in mixed.items():
        assert named(suiting(data, KINDS, remainder)) == what
    assert suiting(line, KINDS, lambda data: Remainder(remainder(data).squares, 30, 0.02)) == []
    # The last row has nothing to be read from: the rest of the rows decides.
    inner = suiting(
        late,
        KINDS,
        lambda data: remainder(Line(data.first[:-1], data.second[:-1], data.output[:-1])),
    )
    assert named(inner) == "output stands a row late"
    flag = inner[0].reading.flag("The output stands a row late.", "IA", gain=2.0)
    assert flag.code == "contradicts-statement"
    assert flag.details == {"statement": "output", "rows": 1, "gain": 2.0}


def test_a_value_that_came_near_to_a_reading_by_chance_seldom_suits() -> None:
    """A single number of any size and sign: its readings suit it as seldom as is stated."""
    rng = np.random.default_rng(2)
    kind = [
        Reading[float](f"the rate is in {unit}", lambda rate, by=factor: by * rate, "rate")
        for unit, factor in DEG_PER_H.items()
    ]
    drawn = 10.0 + 10.0 * rng.standard_cauchy(4000)
    suited = [
        bool(suiting(float(rate), [kind], lambda rate: Remainder((rate - 10.0) ** 2, 1.0)))
        for rate in drawn
    ]
    assert np.mean(suited) < BY_CHANCE


def test_readings_that_the_data_do_not_distinguish_are_all_named_or_none_is() -> None:
    line = made(np.random.default_rng(3))
    wrong = scaled(["first"], -1.0)(line)
    twins = [Reading(f"reading {n}", scaled(["first"], -1.0), "first") for n in range(5)]
    assert len(suiting(wrong, [twins[:3]], remainder)) == 3
    assert suiting(wrong, [twins], remainder) == []
