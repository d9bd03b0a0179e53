"""The first tables: runs, their results, and the instruments that took part."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Create the tables; written out here, since later versions change what the program has."""
    op.create_table(
        "runs",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("host", sa.String, nullable=False),
        sa.Column("run", sa.String, nullable=False),
        sa.Column("folder", sa.String, nullable=False),
        sa.Column("started_utc", sa.String, nullable=False, index=True),
        sa.Column("ended_utc", sa.String),
        sa.Column("procedure", sa.String, nullable=False),
        sa.Column("model", sa.String, nullable=False),
        sa.Column("serial", sa.String, nullable=False, index=True),
        sa.Column("operator", sa.String),
        sa.Column("bench", sa.String, nullable=False, index=True),
        sa.Column("simulated", sa.Boolean, nullable=False),
        sa.Column("check_standard", sa.Boolean, nullable=False),
        sa.Column("state", sa.String, nullable=False),
        sa.Column("verdict", sa.String),
        sa.Column("head", sa.String, nullable=False),
        sa.UniqueConstraint("host", "run"),
    )
    op.create_table(
        "results",
        sa.Column(
            "run_id", sa.Integer, sa.ForeignKey("runs.id", ondelete="CASCADE"), nullable=False
        ),
        sa.Column("name", sa.String, nullable=False),
        sa.Column("axis", sa.String),
        sa.Column("value", sa.Float),
        sa.Column("unit", sa.String, nullable=False),
        sa.Column("standard_uncertainty", sa.Float),
        sa.Column("expanded_uncertainty", sa.Float),
        sa.Column("limit_min", sa.Float),
        sa.Column("limit_max", sa.Float),
        sa.Column("verdict", sa.String, nullable=False),
        sa.Index("results_of_a_run", "run_id"),
        sa.Index("results_by_name", "name", "axis"),
    )
    op.create_table(
        "instruments",
        sa.Column(
            "run_id", sa.Integer, sa.ForeignKey("runs.id", ondelete="CASCADE"), nullable=False
        ),
        sa.Column("instrument", sa.String, nullable=False),
        sa.Column("model", sa.String, nullable=False),
        sa.Column("serial", sa.String, nullable=False, index=True),
        sa.Index("instruments_of_a_run", "run_id"),
    )
