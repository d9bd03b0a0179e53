"""A run's key and the computer of its folder: what is copied or moved is known again."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
UNIQUE = {"uq": "uq_%(table_name)s_%(column_0_name)s"}
"""SQLite gives the constraint of the first version no name."""


def upgrade() -> None:
    """Add the columns; a row has no key until its folder is read again."""
    constraints = sa.inspect(op.get_bind()).get_unique_constraints("runs")
    with op.batch_alter_table("runs", naming_convention=UNIQUE) as runs:
        for constraint in constraints:
            if constraint["column_names"] == ["host", "run"]:
                runs.drop_constraint(constraint["name"] or "uq_runs_host", type_="unique")
        runs.add_column(sa.Column("key", sa.String))
        runs.add_column(sa.Column("computer", sa.String, nullable=False, server_default=""))
        runs.create_unique_constraint("uq_runs_key", ["key"])
    op.execute("UPDATE runs SET computer = host")
