"""What the lists of planted faults share: flags that name a cause, kinds of logs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from fog_logs import Change, Log, log, made
from sabotage import Fault, Made

Maker = Callable[[int], Log]

STATEMENT = frozenset({"contradicts-statement"})
FROZEN = frozenset({"frozen"})
COARSE = frozenset({"coarse-output"})
NOTHING = frozenset({"not-identifiable"})
SHAPE = frozenset({"misfit", "model-too-stiff"})
LEFT_OUT = SHAPE | {"outliers-rejected"}

PAIRS: Maker = log
SINGLE: Maker = partial(log, turns=(360,))
FULL: Maker = partial(log, full=True)
PROVED: Maker = partial(log, proved=True)
DRIVEN: Maker = partial(log, driven=True)
STATED: Maker = partial(log, stated=True)


def faults(
    flags: frozenset[str],
    *named: tuple[str, Change],
    kind: Maker = PAIRS,
    detectable: bool | None = None,
) -> list[Fault]:
    """Return faults that one of the flags names.

    `detectable` where more than the errors of the turns shows them.
    """

    def one(name: str, change: Change) -> Fault:
        def planted(seed: int) -> Made:
            return made(change(kind(seed), np.random.default_rng([seed, 23])))

        return Fault(name, flags, lambda seed: made(kind(seed)), planted, detectable)

    return [one(name, change) for name, change in named]
