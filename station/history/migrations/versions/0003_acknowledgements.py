"""Who acknowledged an alarm of a check standard, when and why."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Create the table."""
    op.create_table(
        "acknowledgements",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("alarm", sa.String, nullable=False, index=True),
        sa.Column("sentence", sa.String, nullable=False),
        sa.Column("who", sa.String, nullable=False),
        sa.Column("acknowledged_utc", sa.String, nullable=False),
        sa.Column("reason", sa.String, nullable=False),
        sa.Column("new_baseline", sa.Boolean, nullable=False),
    )
