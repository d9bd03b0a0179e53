"""Readings that repeat: a navigator that stood still, rows that were copied, a ramp used twice."""

from __future__ import annotations

import numpy as np

from station.findings import Flag, contradiction

from .dataset import Array, FogDataset, Mask, TurnTable

FROZEN_ROWS = 6
COPIED_ROWS, COPIED_BEYOND = 5, 3.0
NO_CHANCE = 1e-6


def repeat_flags(dataset: FogDataset) -> list[Flag]:
    """Return the flags of readings that repeat within a table, and of a proof that is no other."""
    flags = []
    proof = dataset.verification
    for name, table in (("turns", dataset.turns), ("verification", proof)):
        if table is not None and len(table):
            flags += _repeats(name, table)
    copied = 0 if proof is None else int(copied_turns(proof, dataset.turns).sum())
    if proof is not None and copied:
        same_text = (
            f"{copied} of {len(proof)} turns of `verification` have exactly the readings of turns "
            "that the curve is fitted to: they prove nothing and are left out. Verify by another "
            "ramp."
        )
        flags.append(contradiction("verification", same_text, rows=copied))
    return flags


def copied_turns(table: TurnTable, other: TurnTable) -> Mask:
    """Return which rows of a table have the readings of a row of another, where it is no chance."""
    own, others = _angles(table), _angles(other)
    known = {row.tobytes() for row in others}
    copied = np.array([row.tobytes() in known for row in own], dtype=bool)
    both = np.concatenate((own, others))
    return copied & (int(copied.sum()) > _most_by_chance(both))


def _angles(table: TurnTable) -> Array:
    """Return the attitudes before and after, (rows, 6), nothing where there is none."""
    angles = np.column_stack((table.attitude_before_deg, table.attitude_after_deg))
    return np.where(np.isfinite(angles), angles, 0.0) + 0.0


def _most_by_chance(angles: Array) -> float:
    """Return how many rows seldom have the readings of another: coarse ones repeat by chance."""

    def alike(values: Array) -> float:
        count = np.unique(values, axis=0, return_counts=True)[1]
        return float(np.sum(count * (count - 1)) / 2)

    rows = len(angles)
    change = np.round(angles[:, 3:] - angles[:, :3], 7)
    chance = alike(angles[:, :3]) * alike(change) / max(0.5 * rows * (rows - 1), 1.0)
    return COPIED_ROWS + COPIED_BEYOND * chance


def _too_long(marked: Mask) -> bool:
    """Whether marked rows stand in a row, (rows,), where as many as that are no chance."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], marked.astype(int), [0]))))
    longest = int(np.max(edges[1::2] - edges[::2], initial=0))
    often = (int(marked.sum()) - longest + 1) / (len(marked) - longest + 2)
    return longest >= FROZEN_ROWS and len(marked) * often**longest < NO_CHANCE


def _repeats(name: str, table: TurnTable) -> list[Flag]:
    """Return the flag of readings that repeat: a navigator that stood still, or copied rows.

    More turns have exactly the headings of another one than headings before turns, and changes by
    turns, repeat by chance.
    """
    angles = _angles(table)
    change = np.round(angles[:, 3:] - angles[:, :3], 7)
    rows = len(angles)
    if rows < FROZEN_ROWS:
        return []
    repeated = rows - len(np.unique(angles, axis=0))
    same = np.concatenate(([False], np.all(angles[1:] == angles[:-1], axis=1)))
    unmoved = np.all(change == 0.0, axis=1) & (table.commanded_deg != 0.0)
    if _too_long(unmoved):
        what = f"In {int(unmoved.sum())} of {rows} turns of `{name}` no angle changes at all"
    elif _too_long(same) or repeated > _most_by_chance(angles):
        what = f"In `{name}` {repeated} of {rows} turns have exactly the readings of another turn"
    else:
        return []
    repeats_text = (
        f"{what}: a navigator that stood still, or rows that were copied. Leave these rows out."
    )
    return [Flag("frozen", repeats_text, None, {"rows": repeated, "file": name})]
