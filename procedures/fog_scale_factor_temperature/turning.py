"""How far a turn missed its commanded angle, from heading or from full attitude.

Source: fog-scale-factor-temperature document, step 3: the difference of heading before and after a
turn. A turn is a rotation of the body in the navigation frame, C_after C_before^T; its part about
the vertical is what the gyro that points up has sensed. With the x axis up the pitch is 90 deg and
heading alone means nothing, the rotation does.
"""

from __future__ import annotations

import numpy as np

from .dataset import Array, TurnSense, TurnTable

PPM = 1e6
FULL_TURN_DEG = 360.0
SECONDS_PER_HOUR = 3600.0


def wrapped_deg(angle_deg: Array) -> Array:
    """Return angles in (-180, 180] deg."""
    return np.asarray(180.0 - np.mod(180.0 - angle_deg, 360.0))


def rotation_to_navigation(attitude_deg: Array) -> Array:
    """Return C_b^n = Rz(heading) Ry(pitch) Rx(roll) of attitudes (n, 3) in deg, shape (n, 3, 3)."""
    heading, pitch, roll = np.radians(attitude_deg).T
    sh, ch, sp, cp = np.sin(heading), np.cos(heading), np.sin(pitch), np.cos(pitch)
    sr, cr = np.sin(roll), np.cos(roll)
    rows = (
        (ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr),
        (sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.moveaxis(np.array(rows), 2, 0)


def turned_about_down_deg(before_deg: Array, after_deg: Array, full_attitude: bool) -> Array:
    """Return the rotation about the vertical downwards, in the sense of growing heading, wrapped.

    Attitudes have shape (n, 3); without full attitude only the headings are looked at.
    """
    if not full_attitude:
        return wrapped_deg(after_deg[:, 0] - before_deg[:, 0])
    turned = rotation_to_navigation(after_deg) @ np.swapaxes(
        rotation_to_navigation(before_deg), 1, 2
    )
    sine, cosine = turned[:, 1, 0] - turned[:, 0, 1], turned[:, 0, 0] + turned[:, 1, 1]
    return np.asarray(np.degrees(np.arctan2(sine, cosine)))


def turn_errors_deg(turns: TurnTable, sense: TurnSense, full_attitude: bool) -> Array:
    """Return the measured less the commanded angle in the table's sense, wrapped, shape (rows,).

    It is commanded x scale-factor error + bias x time; `sense` says what a positive commanded turn
    is: growing heading, or a positive rotation about the axis that points up.
    """
    down = turned_about_down_deg(turns.attitude_before_deg, turns.attitude_after_deg, full_attitude)
    own = down if sense == "heading" else -down
    return wrapped_deg(own - turns.commanded_deg)
