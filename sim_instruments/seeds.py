"""One random generator per device, the same for the same seed and name on every machine."""

from __future__ import annotations

import hashlib

import numpy as np


def generator(seed: int, name: str) -> np.random.Generator:
    """Return the generator of the device `name` on a bench with this `seed`.

    The name enters by its SHA-256, since Python's own hash changes from process to process.
    """
    words = np.frombuffer(hashlib.sha256(name.encode("utf-8")).digest(), dtype="<u4")
    return np.random.default_rng(np.random.SeedSequence([seed, *(int(word) for word in words)]))
