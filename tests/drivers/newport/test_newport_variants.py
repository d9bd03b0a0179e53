"""The driver of a Newport ESP301 with stages of several kinds."""

from __future__ import annotations

import pytest
from variants import variant

STAGE = ("rotary_stage", "accelerometer-magnetic-sensitivity")


@pytest.mark.parametrize("protected", [False, True])
def test_a_stage_that_protects_its_settings_is_noted(protected: bool) -> None:
    with variant(*STAGE, settings_protected=protected) as here:
        here.driver().programme_limits()
        assert here.met() == (["keeps its own VU", "keeps its own AU"] if protected else [])


def test_a_movement_that_somebody_waits_for_delays_the_driver_and_ends_where_it_should() -> None:
    with variant(*STAGE) as here:
        stage = here.driver()
        stage.home()
        while stage.is_moving():
            here.clock.sleep(0.05)
        began_s = here.clock.now()
        stage._line.command("1PA0.1;1WS")
        assert here.clock.now() - began_s > 0.2, "the settling at least"
        assert not stage.is_moving()
        assert stage.angle_deg() == pytest.approx(0.1, abs=0.002)
