"""One unit of work: a further pose at rest, any way round, for accelerometers and magnetometer."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from station.errors import ConditionNotReached

from .dataset import Array
from .directions import in_words, up_of
from .measuring import ACCELEROMETER_BITS, FIRST_LOOK_S, GYRO_BITS, Sensing
from .parameters import NineAxisParameters, pose_unit
from .placing import lay
from .pose import check_direction
from .work import LATE_OUTPUTS_S

if TYPE_CHECKING:
    from station.method.run import Run

SIGMAS = 3.0
"""So many of its prior a direction between axes may be off."""


def lie(run: Run, word: str, doing: str) -> None:
    """Measure one further pose; a direction that is not up is measured again, then the run ends."""
    parameters: NineAxisParameters = run.parameters
    unit = pose_unit(word)
    if run.is_finished(unit):
        return
    run.may_pause()
    with run.unit(unit, pose=word) as facts:
        for attempt in range(1, parameters.pose.attempts + 1):
            lay(run, word, again=attempt > 1)
            sensing = Sensing(run, unit)
            sensing.follow(run.now_s + parameters.static_settle_s, f"{doing}, it comes to rest")
            from_s = run.now_s
            right, why = False, ""
            for lasts_s in (min(FIRST_LOOK_S, parameters.pose_time_s), parameters.pose_time_s):
                sensing.follow(from_s + lasts_s, doing)
                until_s = run.now_s
                sensing.need_valid(from_s, {**GYRO_BITS, **ACCELEROMETER_BITS})
                right, why = _lies(parameters, word, sensing.means(from_s)[1])
                if not right:
                    break
            sensing.follow(run.now_s + LATE_OUTPUTS_S, doing)
            sensing.stop()
            if right:
                break
            run.event("pose-refused", unit=unit, attempt=attempt, why=why)
            run.say(f"    {unit}: {why}")
        if not right:
            raise ConditionNotReached(
                f"the sensor is to stand with {in_words(word)}; {why}. Look how it stands, and "
                "which of its axes is which"
            )
        facts.update(from_s=from_s, until_s=until_s, attempts=attempt)


def _lies(parameters: NineAxisParameters, word: str, acceleration_g: Array) -> tuple[bool, str]:
    """Return whether a direction points up as well as it should, and what was read."""
    up = up_of(word)
    assert up is not None
    edge_g = SIGMAS * math.radians(parameters.prior.edge_deg) if max(map(abs, up)) < 1.0 else 0.0
    return check_direction(up, acceleration_g, parameters.pose.acceleration_g + edge_g)
