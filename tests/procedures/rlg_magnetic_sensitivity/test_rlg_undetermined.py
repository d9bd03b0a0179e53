"""What a record cannot tell is undetermined, flagged, and never guessed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rlg_records import TRUTH, analysed, off_in_u, record

from procedures.rlg_magnetic_sensitivity.dataset import Segment
from procedures.rlg_magnetic_sensitivity.frequencies import Drive
from procedures.rlg_magnetic_sensitivity.spectrum_plot import spectrum


def cut(segment: Segment, count: int) -> Segment:
    return replace(
        segment,
        time_s=segment.time_s[:count],
        rate_deg_per_h=segment.rate_deg_per_h[:count],
        field_time_s=segment.field_time_s[:count],
        field_mT=segment.field_mT[:count],
    )


def test_an_axis_that_cannot_be_had_does_not_take_the_others_with_it() -> None:
    silent = record(1, TRUTH, {"NA": Drive(0.1, 1.0)})
    silent = replace(silent, field_mT=0.0 * silent.field_mT)
    analysis = analysed(record(0, TRUTH), silent, record(2, TRUTH, {"LA": Drive(0.1, 1.0)}))
    assert [e.axis for e in analysis.estimates] == ["IA", "NA", "LA"]
    assert [e.value is None for e in analysis.estimates] == [False, True, False]
    assert analysis.determined == ("IA", "LA")


def test_twice_the_frequency_beyond_half_the_rate_is_left_out() -> None:
    analysis = analysed(record(0, drive={"IA": Drive(0.3, 1.0)}, interval_s=1.0, cycles=90.0))
    assert analysis.lines[0].quadratic is None
    assert off_in_u(analysis, "IA", 0.05) < 3.5


def test_axes_driven_alike_but_a_quarter_turn_apart_can_be() -> None:
    drive = {"IA": Drive(0.1, 1.0), "NA": Drive(0.1, 1.0)}
    segment = record(0, {}, drive, sigma=0.01)
    angle = 2.0 * np.pi * 0.1 * segment.time_s
    field = np.column_stack((np.cos(angle), np.sin(angle), 0.0 * angle))
    rate = segment.rate_deg_per_h + 0.05 * field[:, 0] - 0.03 * field[:, 1]
    analysis = analysed(replace(segment, field_mT=field, rate_deg_per_h=rate))
    assert analysis.estimates[0].value == pytest.approx(0.05, abs=2e-3)
    assert analysis.estimates[1].value == pytest.approx(-0.03, abs=2e-3)


def test_a_record_that_is_short_against_the_field_s_period_is_drawn_all_the_same() -> None:
    short = cut(record(0), 8)
    analysis = analysed(short)
    assert analysis.lines
    spectrum(analysis.segments[0], analysis.lines)


def test_a_gaussmeter_of_few_digits_is_no_reason_to_give_nothing() -> None:
    segment = record(1, drive={"IA": Drive(0.1, 0.3)}, ambient_mT=(0.012, -0.031, 0.0243))
    analysis = analysed(replace(segment, field_mT=np.round(segment.field_mT, 3)))
    assert analysis.segments[0].field.wild.sum() == 0
    assert off_in_u(analysis, "IA", 0.05) < 3.5
