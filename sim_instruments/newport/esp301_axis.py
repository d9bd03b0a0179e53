"""One axis of a Newport ESP301: its trajectory, its encoder, its limits and what goes wrong.

The axis is driven as a stepper is: open loop along its trajectory, with an encoder that is read.
So a blocked axis loses steps, and a jump of the encoder shows, where a servo would hide it by
turning the axis.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from sim_instruments.faults.instrument import InstrumentFaults
from sim_instruments.faults.lasting import (
    EmergencyStop,
    EncoderJump,
    FollowingError,
    LastingFault,
    Stuck,
)
from sim_instruments.truth import Truth
from sim_instruments.world.rotation import RotationHistory

AXIS = 1
TICK_S = 400e-6
ERRORS_KEPT = 10
TEXTS = {
    0: "NO ERROR DETECTED",
    4: "EMERGENCY SOP ACTIVATED",
    6: "COMMAND DOES NOT EXIST",
    7: "PARAMETER OUT OF RANGE",
    9: "AXIS NUMBER OUT OF RANGE",
    37: "AXIS NUMBER MISSING",
    38: "COMMAND PARAMETER MISSING",
}
AXIS_TEXTS = {
    1: "PARAMETER OUT OF RANGE",
    3: "FOLLOWING ERROR THRESHOLD EXCEEDED",
    6: "POSITIVE SOFTWARE LIMIT DETECTED",
    7: "NEGATIVE SOFTWARE LIMIT DETECTED",
    8: "MOTOR / STAGE NOT CONNECTED",
    10: "MAXIMUM VELOCITY EXCEEDED",
    11: "MAXIMUM ACCELERATION EXCEEDED",
    13: "MOTOR NOT ENABLED",
    17: "ESP CRITICAL SETTINGS ARE PROTECTED",
    20: "HOMING ABORTED",
    30: "COMMAND NOT ALLOWED DURING HOMING",
}
SWITCH_DEG = 2.0
"""How far the edge of the home switch is from the index."""

TRIP_BRAKE = 4.0
"""A motor that trips brakes so many times harder than one that is stopped."""

TRIPS_AFTER = 0.3
"""The part of a movement after which an axis that does not keep up is noticed."""


class EspError(Exception):
    """A refusal by the controller, with its code."""

    def __init__(self, code: int) -> None:
        super().__init__(text_of(code))
        self.code = code


def text_of(code: int) -> str:
    """Return the controller's words for an error code."""
    return TEXTS.get(code) or AXIS_TEXTS.get(code % 100, "Reserved for future use")


class ErrorMemory:
    """First in, first out, ten entries; what comes when it is full is lost."""

    def __init__(self) -> None:
        self._entries: deque[tuple[int, int]] = deque()

    def push(self, code: int, time_s: float) -> None:
        """Keep an error with the time at which it happened."""
        if len(self._entries) < ERRORS_KEPT:
            self._entries.append((code, int(time_s / TICK_S)))

    def pop(self, time_s: float) -> tuple[int, int]:
        """Return and forget the oldest error as code and time stamp; code 0 where there is none."""
        return self._entries.popleft() if self._entries else (0, int(time_s / TICK_S))


class Axis:
    """The axis, whose true angle is `rotation` in the simulated world.

    Truth: `angle_at_start`, where the axis truly stands when the controller is switched on and
    its counter says zero; `encoder_offset`, what the homed encoder reads too much, and, where its
    graduation is off, `encoder_sine` once a turn with `encoder_phase`; `encoder_noise` (rms of one
    reading), `resolution`; `settling`, how long after its profile a movement counts as done;
    `maximum_rate` and `maximum_acceleration` of the stage; `settings_protected`, whether these
    cannot be lowered.
    """

    def __init__(
        self,
        truth: Truth,
        rotation: RotationHistory,
        faults: InstrumentFaults,
        rng: np.random.Generator,
        now: Callable[[], float],
    ) -> None:
        self._rotation, self._faults, self._rng, self._now = rotation, faults, rng, now
        self._offset_deg = truth.quantity("encoder_offset", "deg")
        self._sine_deg = truth.error("encoder_sine", "deg")
        self._phase_deg = truth.error("encoder_phase", "deg")
        self._noise_deg = truth.quantity("encoder_noise", "deg")
        self.step_deg = truth.quantity("resolution", "deg")
        self._settling_s = truth.quantity("settling", "s")
        self.stage_rate = truth.quantity("maximum_rate", "deg/s")
        self.stage_acceleration = truth.quantity("maximum_acceleration", "deg/s^2")
        self.protected = truth.switch("settings_protected")
        start_deg = truth.quantity("angle_at_start", "deg")
        rotation.put(now(), start_deg)
        self._plan = RotationHistory(start_deg)
        self._zero_deg = -start_deg
        self.largest_rate, self.rate = self.stage_rate, self.stage_rate / 2
        self.largest_acceleration = self.stage_acceleration
        self.acceleration = self.deceleration = self.stage_acceleration / 2
        self.emergency_deceleration = TRIP_BRAKE * self.deceleration
        self.low_deg, self.high_deg = -360.0, 360.0
        self.home_rate, self.home_slow_rate, self.home_deg = self.stage_rate / 2, 1.0, 0.0
        self.defined_home_deg = 0.0
        self.motor_on = False
        self.errors = ErrorMemory()
        self._homed_s: float | None = None
        self._trips_s: float | None = None
        self._lost_deg = 0.0
        faults.when_changed(FollowingError.kind, self._falls_behind)
        faults.when_changed(Stuck.kind, self._sticks)
        faults.when_changed(EmergencyStop.kind, self._emergency)

    def catch_up(self) -> None:
        """Let happen what has become due: a trip, the end of a search for home."""
        now_s = self._now()
        if self._trips_s is not None and now_s >= self._trips_s:
            time_s, self._trips_s = self._trips_s, None
            self._trip(3, time_s)
        if self._homed_s is not None and now_s >= self._homed_s:
            time_s, self._homed_s = self._homed_s, None
            if abs(self._rotation.now_at(time_s)[0] - self._plan.now_at(time_s)[0]) > 1e-6:
                self.fail(20, time_s)  # the switch never came
            else:
                self._zero_deg, self._lost_deg = self._offset_deg + self.home_deg, 0.0

    def fail(self, code: int, time_s: float | None = None) -> None:
        """Keep an error of this axis."""
        self.errors.push(100 * AXIS + code, self._now() if time_s is None else time_s)

    def position_deg(self) -> float:
        """Return what the encoder reads."""
        true_deg = self._rotation.now_at(self._now())[0]
        jump = self._faults.now(EncoderJump.kind)
        jump_deg = jump.angle_deg if isinstance(jump, EncoderJump) else 0.0
        noise_deg = self._noise_deg * float(self._rng.standard_normal())
        sine_deg = self._sine_deg * np.sin(np.radians(true_deg + self._phase_deg))
        reading = true_deg + self._zero_deg + sine_deg + jump_deg + noise_deg
        return float(round(reading / self.step_deg) * self.step_deg)

    def desired_deg(self) -> float:
        """Return where the trajectory is."""
        return self._plan.now_at(self._now())[0] + self._zero_deg

    def velocity_deg_per_s(self) -> float:
        """Return how fast the axis turns."""
        return self._rotation.now_at(self._now())[1]

    def is_done(self) -> bool:
        """Return whether the last movement is over and settled."""
        searching = self._homed_s is not None
        return not searching and self.moves_s() <= 0

    def moves_s(self) -> float:
        """Return for how long the movement is not over, 0 or less where it is."""
        return self._plan.at_rest_from_s + self._settling_s - self._now()

    def turns(self) -> bool:
        """Return whether the axis truly turns, or will without another command."""
        return self._now() < self._rotation.at_rest_from_s

    def switch_on(self) -> None:
        """Switch the motor on; refused while the emergency stop is pressed."""
        if self._faults.now(EmergencyStop.kind) is not None:
            raise EspError(4)
        self.motor_on = True

    def switch_off(self) -> None:
        """Brake, and switch the motor off."""
        self.stop()
        self.motor_on = False

    def abort(self) -> None:
        """Brake as in an emergency, and switch the motor off."""
        self._halt(self._emergency_brake())
        self.motor_on = False

    def move_to(self, reading_deg: float) -> None:
        """Begin to turn to an angle of the encoder."""
        self._ready_to_move()
        if reading_deg > self.high_deg:
            raise EspError(100 * AXIS + 6)
        if reading_deg < self.low_deg:
            raise EspError(100 * AXIS + 7)
        self._go(self._now(), reading_deg - self._zero_deg, self.rate)
        self._may_fall_behind()

    def move_by(self, angle_deg: float) -> None:
        """Begin to turn by an angle."""
        self.move_to(self.desired_deg() + angle_deg)

    def stop(self) -> None:
        """Brake to rest; a search for home ends without one."""
        self._halt(self.deceleration)

    def _halt(self, deceleration: float) -> None:
        self._brake(self._now(), deceleration)
        self._trips_s = None
        if self._homed_s is not None:
            self._homed_s = None
            self.fail(20)

    def search_home(self) -> None:
        """Turn fast to the edge of the home switch, then slowly to the index."""
        self._ready_to_move()
        now_s = self._now()
        index_deg = -self._offset_deg
        # Found by switch and index, wherever the counter thinks that it is.
        true_deg = self._rotation.now_at(now_s)[0]
        self._plan.put(now_s, true_deg)
        self._lost_deg = 0.0
        side = SWITCH_DEG if true_deg >= index_deg else -SWITCH_DEG
        edge_s = self._go(now_s, index_deg + side, min(self.home_rate, self.largest_rate))
        slow_rate = min(self.home_slow_rate, self.largest_rate)
        self._homed_s = self._go(edge_s, index_deg, slow_rate) + self._settling_s
        self._may_fall_behind()

    def define_home(self, reading_deg: float) -> None:
        """Let the encoder read an angle where it stands now."""
        self._zero_deg += reading_deg - self.desired_deg()
        self.defined_home_deg = reading_deg

    def _ready_to_move(self) -> None:
        if self._homed_s is not None:
            raise EspError(100 * AXIS + 30)
        if not self.motor_on:
            raise EspError(100 * AXIS + 13)

    def _go(self, time_s: float, true_deg: float, rate: float) -> float:
        up, down = self.acceleration, self.deceleration
        if self._faults.now(Stuck.kind) is None:
            self._rotation.move_to(time_s, true_deg + self._lost_deg, rate, up, down)
        return self._plan.move_to(time_s, true_deg, rate, up, down)

    def _brake(self, time_s: float, deceleration: float) -> None:
        self._plan.stop(time_s, deceleration)
        self._rotation.stop(time_s, deceleration)

    def _emergency_brake(self) -> float:
        """Return the deceleration of an emergency, never below that of a stop."""
        return max(self.emergency_deceleration, self.deceleration)

    def _may_fall_behind(self) -> None:
        """Plan the trip of a movement that will not keep up, so that the world knows it at once."""
        if self._faults.now(FollowingError.kind) is None:
            self._trips_s = None
            return
        now_s = self._now()
        self._trips_s = now_s + TRIPS_AFTER * (self._plan.at_rest_from_s - now_s)
        self._brake(self._trips_s, TRIP_BRAKE * self.deceleration)

    def _trip(self, code: int, time_s: float) -> None:
        self.fail(code, time_s)
        self.motor_on = False
        self._homed_s = None

    def _falls_behind(self, time_s: float, fault: LastingFault | None) -> None:
        self.catch_up()
        if fault is not None and time_s < self._plan.at_rest_from_s:
            self._brake(time_s, TRIP_BRAKE * self.deceleration)
            self._trips_s = None
            self._trip(3, time_s)

    def _sticks(self, time_s: float, fault: LastingFault | None) -> None:
        if fault is not None:
            self._rotation.halt(time_s)
            return
        end_s = max(time_s, self._plan.at_rest_from_s)
        self._lost_deg = self._rotation.now_at(time_s)[0] - self._plan.now_at(end_s)[0]

    def _emergency(self, time_s: float, fault: LastingFault | None) -> None:
        if fault is None:
            return
        self._brake(time_s, self._emergency_brake())
        self.motor_on, self._trips_s, self._homed_s = False, None, None
        self.errors.push(4, time_s)
