"""A drive with many turns, made by equations of its own, and its truth.

For whoever wants to try the vehicle test: laps of a yard, all in one sense, on ground that is not
quite level, in a gyro that cools down meanwhile. The vehicle ends in the heading in which it began.
`config/drives/NAME.truth.json` holds what a drive that comes with the station was made of;
`PYTHONPATH=. python tests/support/simulated_drive.py NAME.truth.json` prints it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from fog_fixture import EARTH_DEG_PER_S

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.fog_scale_factor_temperature.dataset import AXES, PPM, Array, Drive

STOP_S = 20.0
STRAIGHT_S = 40.0
TURN_RATE_DEG_PER_S = 15.0
TILT_DEG = 0.6
TILT_PERIOD_S = 37.0
COOLING_S = 1500.0

ErrorOfTemperature = Callable[[Array], Array]


def simulated_drive(
    error_ppm: Mapping[str, ErrorOfTemperature],
    *,
    laps: int = 20,
    latitude_deg: float = 40.0,
    first_heading_deg: float = 25.0,
    first_heading_known: bool = True,
    sample_interval_s: float = 0.1,
    temperature_degC: tuple[float, float] = (45.0, 20.0),
    bias_deg_per_h: float = 0.0,
    random_walk_deg_per_sqrt_h: float = 0.0,
    seed: int = 1,
) -> Drive:
    """Return a drive of `laps` times four corners of 90 deg, with its true heading.

    `error_ppm` gives each axis' true scale-factor error in ppm at temperatures (n,); the gyros go
    from one temperature to the other. Rates are means over sample intervals, stamped in the middle.
    """
    corner_s = 90.0 / TURN_RATE_DEG_PER_S
    pattern = [(STOP_S, 0.0)]
    pattern += [(STRAIGHT_S, 0.0), (corner_s, TURN_RATE_DEG_PER_S)] * (4 * laps)
    pattern += [(STOP_S, 0.0)]
    ends = np.cumsum([span for span, _ in pattern])
    edges = np.arange(0.0, ends[-1] + 0.5 * sample_interval_s, sample_interval_s)
    corners = np.concatenate(([0.0], ends))
    turned = np.concatenate(([0.0], np.cumsum([span * rate for span, rate in pattern])))
    heading = np.radians(first_heading_deg + np.interp(edges, corners, turned))
    # The ground's tilt goes in and out with the time, none at both ends.
    share = np.sin(np.pi * edges / edges[-1]) ** 2 * np.radians(TILT_DEG)
    roll = share * np.sin(2.0 * np.pi * edges / TILT_PERIOD_S)
    pitch = share * np.sin(2.0 * np.pi * edges / (1.3 * TILT_PERIOD_S) + 1.0)
    rate = _body_rates_deg_per_s(heading, pitch, roll, latitude_deg, sample_interval_s)
    time_s = 0.5 * (edges[1:] + edges[:-1])
    warm, cool = temperature_degC
    heat = cool + (warm - cool) * np.exp(-time_s / COOLING_S)
    generator = np.random.default_rng(seed)
    noise = random_walk_deg_per_sqrt_h / np.sqrt(sample_interval_s * SECONDS_PER_HOUR)
    measured = rate * (1.0 + np.column_stack([error_ppm[axis](heat) for axis in AXES]) / PPM)
    measured = measured + bias_deg_per_h / SECONDS_PER_HOUR
    measured = measured + noise * generator.standard_normal(measured.shape)
    middle = np.degrees(0.5 * (heading[1:] + heading[:-1]))
    return Drive(
        time_s=time_s,
        rate_deg_per_s=measured,
        temperature_degC=np.column_stack([heat] * 3),
        latitude_deg=latitude_deg,
        heading_deg=middle,
        first_heading_deg=first_heading_deg,
        first_heading_known=first_heading_known,
    )


def drive_of_truth(truth: Mapping[str, Any]) -> Drive:
    """Return the drive that a truth file describes.

    `made_of` holds arguments of `simulated_drive`; `scale_factor_error_ppm` the curve of each axis
    by the powers of u, which goes from -1 to 1 over `temperature_range_degC`.
    """
    low, high = truth["temperature_range_degC"]

    def curve(powers: list[float]) -> ErrorOfTemperature:
        return lambda heat: np.polyval(powers[::-1], (2.0 * heat - low - high) / (high - low))

    errors = {axis: curve(powers) for axis, powers in truth["scale_factor_error_ppm"].items()}
    return simulated_drive(errors, **truth["made_of"])


def drive_csv(drive: Drive) -> str:
    """Return a drive as the CSV file of an imported dataset, reference heading included."""
    head = ["t_s", *(f"rate_{axis}_deg_per_s" for axis in AXES)]
    head += [f"temperature_{axis}_degC" for axis in AXES]
    columns = [drive.time_s, *drive.rate_deg_per_s.T, *drive.temperature_degC.T]
    if drive.heading_deg is not None:
        head.append("heading_deg")
        columns.append(np.mod(drive.heading_deg, 360.0))
    lines = [",".join(head)]
    lines += [",".join(f"{cell:.8g}" for cell in row) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"


def _body_rates_deg_per_s(
    heading: Array, pitch: Array, roll: Array, latitude_deg: float, step_s: float
) -> Array:
    """Return mean body rates with the earth's in them, (n - 1, 3), of Euler angles (n,) in rad."""
    mean = [0.5 * (one[1:] + one[:-1]) for one in (heading, pitch, roll)]
    change = [np.diff(one) / step_s for one in (heading, pitch, roll)]
    (sh, sp, sr), (ch, cp, cr) = np.sin(mean), np.cos(mean)
    own = np.array(
        [
            change[2] - sp * change[0],
            cr * change[1] + sr * cp * change[0],
            -sr * change[1] + cr * cp * change[0],
        ]
    )
    earth = np.radians(EARTH_DEG_PER_S)
    latitude = np.radians(latitude_deg)
    north, down = earth * np.cos(latitude), -earth * np.sin(latitude)
    turned = np.array(
        [
            cp * ch * north - sp * down,
            (sr * sp * ch - cr * sh) * north + sr * cp * down,
            (cr * sp * ch + sr * sh) * north + cr * cp * down,
        ]
    )
    return np.asarray(np.degrees(own + turned).T)


if __name__ == "__main__":
    described = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    sys.stdout.write(drive_csv(drive_of_truth(described)))
