"""The tables of the history: a row for each run, each result, each instrument that took part."""

from __future__ import annotations

from sqlalchemy import (
    Boolean,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
)

METADATA = MetaData()

RUNS = Table(
    "runs",
    METADATA,
    Column("id", Integer, primary_key=True),
    Column("key", String, unique=True),
    Column("host", String, nullable=False),
    Column("run", String, nullable=False),
    Column("computer", String, nullable=False),
    Column("folder", String, nullable=False, index=True),
    Column("started_utc", String, nullable=False, index=True),
    Column("ended_utc", String),
    Column("procedure", String, nullable=False),
    Column("model", String, nullable=False),
    Column("serial", String, nullable=False, index=True),
    Column("operator", String),
    Column("bench", String, nullable=False, index=True),
    Column("simulated", Boolean, nullable=False),
    Column("check_standard", Boolean, nullable=False),
    Column("state", String, nullable=False),
    Column("verdict", String),
    Column("head", String, nullable=False),
)
"""A run, wherever its folder is: `key` is made of the first line of its log, None until a folder
that an earlier version took in is read again. `host` is the computer that ran it, `computer` the
one that has the `folder`. `head` is the SHA-256 of the run's manifest, which holds that of every
file of the run.
"""

RESULTS = Table(
    "results",
    METADATA,
    Column("run_id", Integer, ForeignKey("runs.id", ondelete="CASCADE"), nullable=False),
    Column("name", String, nullable=False),
    Column("axis", String),
    Column("value", Float),
    Column("unit", String, nullable=False),
    Column("standard_uncertainty", Float),
    Column("expanded_uncertainty", Float),
    Column("limit_min", Float),
    Column("limit_max", Float),
    Column("verdict", String, nullable=False),
    Index("results_of_a_run", "run_id"),
    Index("results_by_name", "name", "axis"),
)

INSTRUMENTS = Table(
    "instruments",
    METADATA,
    Column("run_id", Integer, ForeignKey("runs.id", ondelete="CASCADE"), nullable=False),
    Column("instrument", String, nullable=False),
    Column("model", String, nullable=False),
    Column("serial", String, nullable=False, index=True),
    Index("instruments_of_a_run", "run_id"),
)

ACKNOWLEDGEMENTS = Table(
    "acknowledgements",
    METADATA,
    Column("id", Integer, primary_key=True),
    Column("alarm", String, nullable=False, index=True),
    Column("sentence", String, nullable=False),
    Column("who", String, nullable=False),
    Column("acknowledged_utc", String, nullable=False),
    Column("reason", String, nullable=False),
    Column("new_baseline", Boolean, nullable=False),
)
"""Who took note of an alarm, and why; rows are added alone, and no folder of a run holds them."""
