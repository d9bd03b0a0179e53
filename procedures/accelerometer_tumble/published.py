"""The multipoint formulas: a Fourier series over evenly spaced positions of one mounting.

K0 = B0 + C2, Ki = S1 + 3 S3, Kii = -2 C2, Kiii = -4 S3, Kio = 2 S2, Ko = C1: the fixture's error,
the encoder's and drift are taken for the device's.
"""

from __future__ import annotations

import numpy as np

from station.findings import Published

from .dataset import TumbleDataset
from .model import GRAVITY_POWER, UNITS

METHOD = "fourier"
FEWEST = 8
EVEN_DEG = 0.01
IN_PLANE = {"io": ("Kio", "Ko"), "ip": ("Kip", "Kp")}
NAMES = ("K0", "Ki", "Kii", "Kiii", "Kio", "Kip", "Ko", "Kp")


def published_values(dataset: TumbleDataset) -> list[Published]:
    """Return what the formulas give on each plane's first mounting, None where they cannot run."""
    values: dict[str, float | None] = dict.fromkeys(NAMES)
    for plane, (product, cross) in IN_PLANE.items():
        series = _series(dataset, plane)
        if series is None:
            continue
        mean, sine, cosine = series
        for name, value in (
            ("K0", mean + cosine[1]),
            ("Ki", sine[0] + 3.0 * sine[2]),
            ("Kii", -2.0 * cosine[1]),
            ("Kiii", -4.0 * sine[2]),
            (product, 2.0 * sine[1]),
            (cross, cosine[0]),
        ):
            if values[name] is None:
                power = GRAVITY_POWER[UNITS[name]]
                values[name] = value / dataset.gravity_g**power
    return [Published(name, None, value, UNITS[name], METHOD) for name, value in values.items()]


def _series(dataset: TumbleDataset, plane: str) -> tuple[float, list[float], list[float]] | None:
    own = dataset.mounting
    first = np.flatnonzero((dataset.plane == plane) & (dataset.reverse > 0.0))
    if not len(first):
        return None
    rows = own == own[first[0]]
    angle = np.mod(np.rad2deg((dataset.commanded_rad + dataset.head_rad)[rows]), 360.0)
    place, index = np.unique(np.round(angle, 6) % 360.0, return_inverse=True)
    if len(place) < FEWEST or np.ptp(np.diff(np.append(place, place[0] + 360.0))) > EVEN_DEG:
        return None
    output = dataset.output_V[rows]
    mean = np.bincount(index, output) / np.bincount(index)
    theta = np.deg2rad(place)
    sine = [2.0 * float(np.mean(mean * np.sin(n * theta))) for n in (1, 2, 3)]
    cosine = [2.0 * float(np.mean(mean * np.cos(n * theta))) for n in (1, 2)]
    return float(np.mean(mean)), sine, cosine
