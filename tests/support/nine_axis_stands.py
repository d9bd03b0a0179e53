"""Stands and turns of a nine-axis sensor with known errors, written from the physics alone."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from procedures.nine_axis_calibration.all_axes.reading import lean_rad
from procedures.nine_axis_calibration.all_axes.stands import (
    Mounted,
    OtherAxes,
    Rest,
    Turned,
    direction,
)
from procedures.nine_axis_calibration.dataset import TurnRecord
from procedures.nine_axis_calibration.parameters import AllAxesPrior

Array = NDArray[np.float64]
FIELD_NT, INCLINATION_DEG = 54823.0, 58.8
LATITUDE_DEG, EARTH_DEG_PER_H = 39.9, 15.041067
RATES = (10.0, 50.0, 100.0)
FACES = ("-X", "-Y", "-Z")
EDGES = ("X+Y", "Y+Z", "X+Z", "-X-Y", "-Y-Z", "-X-Z")


@dataclass(frozen=True)
class Sensor:
    """A sensor's errors: accelerometers b (g), K, N, k2; gyros K, M; boresight (rad); magnetometer
    o (nT) and A; lever arms (3, 3) in g per (rad/s)^2."""

    bias_g: Array
    scale: Array
    shape: Array
    second: Array
    boresight: Array
    gyro_scale: Array
    gyro_towards: Array
    per_g: Array
    offset_nT: Array
    gain: Array


@dataclass
class Bench:
    """How well everything is put, and how noisy it is; `seed` draws all of it."""

    seed: int
    tilt_arcmin: float = 0.5
    edge_deg: float = 1.0
    accelerometer_g: float = 1e-4
    magnetometer_nT: float = 30.0
    gyro_deg_per_s: float = 2e-4
    samples: int = 60
    poses: tuple[str, ...] = (*FACES, *EDGES)
    turned: tuple[str, ...] = ("X", "Y", "Z")
    field_at_poses: bool = True
    mounting_arcmin: float | None = None
    """How a person mounts the sensor on the table, as the tilt where None."""
    lever_g: float = 1e-3
    """Lever arms in g per (rad/s)^2: 10 cm are 0.01."""
    apart_g: float = 0.0
    """How far the accelerometers' places differ, in the same unit."""
    accelerometer_step_g: float = 0.0
    accelerometer_limit_g: float = np.inf
    magnetometer_step_nT: float = 0.0
    magnetometer_limit_nT: float = np.inf
    platform_nT: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """A field fixed to what turns: along its north at the encoder's zero, its west there, up."""
    stands_on_platform: bool = False
    axis_lean: bool = True
    rates: tuple[float, ...] = RATES
    inclination: bool = False
    draw: np.random.Generator = field(init=False)
    sensor: Sensor = field(init=False)

    def __post_init__(self) -> None:
        self.draw = np.random.default_rng(self.seed)
        self.sensor = sensor_of(self.draw)

    def data(self) -> OtherAxes:
        """Return what the bench records."""
        stated = {
            "heading": "10 arcmin",
            "relative_heading": "0.5 arcmin",
            "tilt": f"{self.tilt_arcmin} arcmin",
            "accelerometer_bias": "0.001 g",
            "edge": f"{self.edge_deg} deg",
        }
        if self.mounting_arcmin is not None:
            stated["mounting"] = f"{self.mounting_arcmin} arcmin"
        prior = AllAxesPrior.model_validate(stated)
        axis_lean = self.draw.normal(0.0, np.radians(self.tilt_arcmin / 60.0))
        rests = [self._rest(prior, word) for word in ("Z", *self.poses)]
        mountings = [self._mounting(prior, word, axis_lean) for word in self.turned]
        return OtherAxes(
            tuple(rests),
            tuple(mountings),
            LATITUDE_DEG,
            np.radians(self.tilt_arcmin / 60.0),
            field_nT=FIELD_NT + self.draw.normal(0.0, 50.0),
            field_u_nT=50.0,
            inclination_rad=np.radians(INCLINATION_DEG + self.draw.normal(0.0, 0.1))
            if self.inclination
            else None,
            inclination_u_rad=np.radians(0.1) if self.inclination else 0.0,
        )

    def _up(
        self, prior: AllAxesPrior, word: str, arcmin: float | None = None
    ) -> tuple[Array, Array, float]:
        """Return nominal and true direction of up in the sensor, and how well it is known."""
        nominal = direction(word)
        assert nominal is not None
        u_rad = lean_rad(prior, nominal, prior.tilt_arcmin if arcmin is None else arcmin)
        across = np.linalg.svd(nominal[None, :])[2][1:]
        base = nominal + self.draw.normal(0.0, u_rad, 2) @ across
        turn = Rotation.from_rotvec(self.sensor.boresight)
        return nominal, turn.apply(base / np.linalg.norm(base)), u_rad

    def _force(self, force_g: Array) -> Array:
        """Return what accelerometers read of specific forces (n, 3), with noise."""
        one = self.sensor
        read = one.bias_g + one.scale * (force_g @ one.shape.T) + one.second * force_g**2
        read = read + self.draw.normal(0.0, self.accelerometer_g, force_g.shape)
        return recorded(read, self.accelerometer_step_g, self.accelerometer_limit_g)

    def _magnetic(self, field_nT: Array) -> Array:
        """Return what the magnetometer reads of fields (n, 3), with noise."""
        read = self.sensor.offset_nT + field_nT @ self.sensor.gain.T
        read = read + self.draw.normal(0.0, self.magnetometer_nT, field_nT.shape)
        return recorded(read, self.magnetometer_step_nT, self.magnetometer_limit_nT)

    def _rest(self, prior: AllAxesPrior, word: str) -> Rest:
        nominal, up, u_rad = self._up(prior, word)
        count = self.samples
        level, upwards = earth_field(0.0)
        north = across_at(up, self.draw.uniform(0.0, 2.0 * np.pi))
        whole = np.tile(up * upwards + level * north, (count, 1))
        if self.stands_on_platform:
            whole = whole + self._of_platform(up, across_at(up, self.draw.uniform(0.0, 2 * np.pi)))
        return Rest(
            f"pose {word}",
            nominal,
            u_rad,
            np.arange(1.0, count + 1.0),
            self._force(np.tile(up, (count, 1))),
            self._magnetic(whole) if self.field_at_poses else None,
        )

    def _of_platform(self, up: Array, north: Array) -> Array:
        """Return the platform's field (3,) in the sensor, by where north is at its zero."""
        first, second, along = self.platform_nT
        return np.asarray(first * north + second * np.cross(up, north) + along * up)

    def _mounting(self, prior: AllAxesPrior, word: str, axis_lean: float) -> Mounted:
        nominal, up, u_rad = self._up(prior, word, self.mounting_arcmin)
        level, upwards = earth_field(axis_lean)
        north = across_at(up, self.draw.uniform(0.0, 2.0 * np.pi))
        arm = self.draw.normal(0.0, self.lever_g, 3)
        apart = self.draw.normal(0.0, self.apart_g, (3, 3)) if self.apart_g else np.zeros((3, 3))
        # The force at the place of each accelerometer, of which it feels its own component.
        arms = arm + apart
        arms -= (arms @ up)[:, None] * up
        records = []
        for rate in [sense * one for one in self.rates for sense in (1.0, -1.0)]:
            count = max(round(360.0 / abs(rate) * 2.0), 36)
            end_deg = self.draw.uniform(0.0, 360.0) + rate * np.arange(1.0, count + 1.0)
            middle = np.radians(end_deg - 0.5 * rate)[:, None]
            shrunk = np.sinc(rate / 360.0)
            field_nT = up * upwards + level * shrunk * (
                north * np.cos(middle) - np.cross(up, north) * np.sin(middle)
            )
            field_nT = field_nT + self._of_platform(up, north)
            spin = np.radians(rate)
            force = np.tile(up + np.diag(arms) * spin**2, (count, 1))
            turned = self.sensor.gyro_scale * (self.sensor.gyro_towards @ up) * rate
            earth = EARTH_DEG_PER_H * np.sin(np.radians(LATITUDE_DEG)) / 3600.0
            still = self.sensor.gyro_scale * up * earth + self.sensor.per_g @ up / 3600.0
            noise = self.draw.normal(0.0, self.gyro_deg_per_s, (count, 3))
            turn = TurnRecord(
                int(np.argmax(np.abs(nominal))),
                rate,
                np.arange(1.0, count + 1.0),
                turned + still + noise,
                end_deg % 360.0,
            )
            records.append(Turned(turn, self._force(force), self._magnetic(field_nT)))
        return Mounted(f"mounting {word}", nominal, u_rad, tuple(records))


def recorded(values: Array, step: float, limit: float) -> Array:
    """Return values as a recorder of these steps, cut off at a limit, writes them."""
    rounded = np.round(values / step) * step if step else values
    return np.asarray(np.clip(rounded, -limit, limit))


def sensor_of(draw: np.random.Generator) -> Sensor:
    """Return a sensor with errors of the usual sizes."""
    shape = draw.normal(0.0, 3e-4, (3, 3))
    return Sensor(
        draw.normal(0.0, 1e-3, 3),
        1.0 + draw.normal(0.0, 3e-4, 3),
        np.eye(3) + 0.5 * (shape + shape.T) * (1.0 - np.eye(3)),
        draw.normal(0.0, 5e-5, 3),
        draw.normal(0.0, 3e-4, 3),
        1.0 + draw.normal(0.0, 1e-4, 3),
        np.eye(3) + draw.normal(0.0, 3e-4, (3, 3)) * (1.0 - np.eye(3)),
        draw.normal(0.0, 0.1, (3, 3)),
        draw.normal(0.0, 1500.0, 3),
        np.eye(3) + draw.normal(0.0, 0.01, (3, 3)),
    )


def earth_field(axis_lean_rad: float) -> tuple[float, float]:
    """Return the field across and along an axis that leans towards the field, in nT."""
    angle = np.radians(INCLINATION_DEG) + axis_lean_rad
    return FIELD_NT * float(np.cos(angle)), -FIELD_NT * float(np.sin(angle))


def across_at(up: Array, azimuth: float) -> Array:
    """Return the unit vector (3,) across `up` at an azimuth."""
    first = np.linalg.svd(up[None, :])[2][1]
    return np.asarray(np.cos(azimuth) * first + np.sin(azimuth) * np.cross(up, first))


def truth_of(sensor: Sensor) -> dict[tuple[str, str], float]:
    """Return the true value of every result, by name and axis."""
    arcsec = float(np.degrees(1.0)) * 3600.0
    axes = "XYZ"
    found: dict[tuple[str, str], float] = {}
    for n, axis in enumerate(axes):
        found["accelerometer_bias", axis] = sensor.bias_g[n]
        found["accelerometer_scale_factor", axis] = sensor.scale[n]
        found["accelerometer_second_order", axis] = 1e6 * sensor.second[n]
        found["boresight", axis] = arcsec * sensor.boresight[n]
        found["scale_factor", axis] = sensor.gyro_scale[n]
        found["magnetometer_offset", axis] = sensor.offset_nT[n]
        found["magnetometer_scale_factor", axis] = sensor.gain[n, n]
        for m, other in enumerate(axes):
            found["g_sensitivity", axis + other] = sensor.per_g[n, m]
            if n < m:
                cross = 2.0 * arcsec * sensor.shape[n, m]
                found["accelerometer_nonorthogonality", axis + other] = cross
            if n != m:
                found["misalignment", axis + other] = arcsec * sensor.gyro_towards[n, m]
                lean = arcsec * sensor.gain[n, m] / sensor.gain[n, n]
                found["magnetometer_misalignment", axis + other] = lean
    return found


CONDITIONS = """\
dataset: 1
procedure: nine-axis-calibration
files: {static: static.csv, rate: rate.csv, poses: poses.csv}
conditions:
  latitude: 39.9 deg
  local_gravity: GRAVITY g
  earth_field: {magnitude: FIELD nT}
  prior:
    heading: 10 arcmin
    relative_heading: 0.5 arcmin
    tilt: TILT arcmin
    edge: EDGE deg
    mounting: MOUNTING arcmin
    accelerometer_bias: 0.001 g
    earth_field_magnitude: 50 nT
"""


def write(data: OtherAxes, folder: Path) -> Path:
    """Write stands and turns as a dataset: position 1 is the first stand, the others are poses."""
    per_arcmin = 60.0 * float(np.degrees(1.0))
    edges = [rest.u_rad for rest in data.rests if np.count_nonzero(rest.up) > 1]
    known = {
        "GRAVITY": data.gravity_g,
        "FIELD": data.field_nT or FIELD_NT,
        "TILT": data.rests[0].u_rad * per_arcmin,
        "EDGE": np.degrees(edges[0]) if edges else 1.0,
        "MOUNTING": data.mountings[0].u_rad * per_arcmin,
    }
    conditions = CONDITIONS
    for word, value in known.items():
        conditions = conditions.replace(word, f"{value:.9g}")
    (folder / "dataset.yaml").write_text(conditions, encoding="utf-8")
    first = data.rests[0]
    static = ["position,t_s,gx_deg_per_h,gy_deg_per_h,gz_deg_per_h,ax_g,ay_g,az_g"]
    noise = np.random.default_rng(1).normal(0.0, 0.7, (len(first.time_s), 3))
    for t_s, rate, force in zip(first.time_s, noise, first.acceleration_g, strict=True):
        values = (t_s, rate[0], 11.54 + rate[1], 9.65 + rate[2], *force)
        static.append(f"1,{','.join(f'{value:.9g}' for value in values)}")
    poses = ["pose,t_s,ax_g,ay_g,az_g,mx_nT,my_nT,mz_nT"]
    for rest in data.rests[1:]:
        assert rest.field_nT is not None
        for row in np.column_stack((rest.time_s, rest.acceleration_g, rest.field_nT)):
            word = rest.name.removeprefix("pose ")
            poses.append(f"{word},{','.join(f'{value:.9g}' for value in row)}")
    rate = [
        "axis,commanded_deg_per_s,t_s,gx_deg_per_s,gy_deg_per_s,gz_deg_per_s,"
        "ax_g,ay_g,az_g,mx_nT,my_nT,mz_nT,encoder_deg"
    ]
    for mounted in data.mountings:
        for one in mounted.records:
            assert one.acceleration_g is not None
            assert one.field_nT is not None
            turn = one.turn
            columns = (turn.time_s, turn.rate_deg_per_s, one.acceleration_g, one.field_nT)
            for row, angle in zip(np.column_stack(columns), turn.encoder_deg, strict=True):
                numbers = ",".join(f"{value:.9g}" for value in (*row, angle))
                word = mounted.name.removeprefix("mounting ")
                rate.append(f"{word},{turn.commanded_deg_per_s:g},{numbers}")
    for name, lines in (("static", static), ("poses", poses), ("rate", rate)):
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder
