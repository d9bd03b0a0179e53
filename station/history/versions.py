"""The version of the tables: brought up to date by Alembic where it is not the newest."""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import Engine, inspect, text

MIGRATIONS = Path(__file__).parent / "migrations"
NEWEST = "0003"


def bring_up_to_date(engine: Engine) -> None:
    """Make the tables those of this program; Alembic is imported only where there is work for it.

    Tables of a newer program are used as they are: columns are added, never renamed.
    """
    with engine.begin() as connection:
        if inspect(connection).has_table("alembic_version"):
            version = connection.execute(text("SELECT version_num FROM alembic_version")).scalar()
            if version is not None and version >= NEWEST:
                return
        from alembic import command
        from alembic.config import Config

        config = Config()
        config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
        config.attributes["connection"] = connection
        command.upgrade(config, "head")
