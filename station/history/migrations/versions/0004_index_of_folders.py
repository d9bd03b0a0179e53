"""An index of the folders: whoever takes a run in asks what there is of its folder."""

from __future__ import annotations

from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Create the index."""
    op.create_index("ix_runs_folder", "runs", ["folder"])
