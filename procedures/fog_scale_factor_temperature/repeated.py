"""Readings that repeat: a navigator that stood still, rows that were copied, a ramp used twice."""

from __future__ import annotations

import numpy as np

from procedures.estimation.flags import frozen
from procedures.estimation.frozen import COPIED_ROWS, TURNS_IN_A_ROW, no_chance
from station.findings import Flag, contradiction

from .dataset import Array, FogDataset, Mask, TurnTable

COPIED_BEYOND = 3.0


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


def _repeats(name: str, table: TurnTable) -> list[Flag]:
    """Return the flag of readings that repeat: a navigator that stood still, or copied rows.

    More turns have exactly the headings of another one than headings before turns, and changes by
    turns, repeat by chance.
    """
    angles = _angles(table)
    change = np.round(angles[:, 3:] - angles[:, :3], 7)
    rows = len(angles)
    if rows < TURNS_IN_A_ROW:
        return []
    repeated = rows - len(np.unique(angles, axis=0))
    same = np.concatenate(([False], np.all(angles[1:] == angles[:-1], axis=1)))
    unmoved = np.all(change == 0.0, axis=1) & (table.commanded_deg != 0.0)
    if no_chance(unmoved):
        reading, count, though = "before the turn", int(unmoved.sum()), ", though the table turned"
    elif no_chance(same) or repeated > _most_by_chance(angles):
        reading, count, though = "of another turn", repeated, ""
    else:
        return []
    extent = f"{count} of {rows} turns of `{name}`"
    details: dict[str, object] = {"rows": repeated, "file": name}
    return [
        frozen(
            f"The attitude {reading}",
            extent,
            "the navigator",
            "Leave these rows out.",
            details,
            though=though,
        )
    ]
