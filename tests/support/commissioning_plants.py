"""Faults that a commissioning must name, planted into a simulated bench.

Each part has a file of its own, `plants_<part>.py`, whose `PLANTS` are collected here.
"""

from __future__ import annotations

from plants import Plant
from plants_chamber import PLANTS as CHAMBER
from plants_clocks import PLANTS as CLOCKS
from plants_coils import PLANTS as COILS
from plants_contacts import PLANTS as CONTACTS
from plants_gyro import PLANTS as GYRO
from plants_lines import PLANTS as LINES
from plants_motion import PLANTS as MOTION
from plants_pick_up import PLANTS as PICK_UP
from plants_probe import PLANTS as PROBE
from plants_stage import PLANTS as STAGE
from plants_start import PLANTS as START
from plants_supplies import PLANTS as SUPPLIES

ALL_PLANTS: tuple[Plant, ...] = (
    *START,
    *COILS,
    *LINES,
    *CONTACTS,
    *SUPPLIES,
    *PROBE,
    *PICK_UP,
    *MOTION,
    *STAGE,
    *GYRO,
    *CHAMBER,
    *CLOCKS,
)
"""What tests and benchmark plant."""
