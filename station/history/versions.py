"""The version of the tables: brought up to date by Alembic where it is not the newest."""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import Connection, Engine, inspect, text

MIGRATIONS = Path(__file__).parent / "migrations"
NEWEST = "0004"


LOCK = 0x5747_1155
"""The number of the lock that whoever writes to a history on PostgreSQL holds."""
PATIENCE_S = 30.0
"""So long a process waits for another to have written."""


def bring_up_to_date(engine: Engine) -> None:
    """Make the tables those of this program; Alembic is imported only where there is work for it.

    Tables of a newer program are used as they are: columns are added, never renamed.
    """
    with engine.begin() as connection:
        if _are_up_to_date(connection):
            return
    with engine.begin() as connection:
        write_alone(connection)
        if _are_up_to_date(connection):  # another process was first
            return
        from alembic import command
        from alembic.config import Config

        config = Config()
        config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def write_alone(connection: Connection) -> None:
    """Wait until no other process writes to the history, and keep others out until the commit.

    Whoever writes looks first at what is there of a run: two at once would each miss the other's.
    """
    match connection.dialect.name:
        case "sqlite":
            connection.exec_driver_sql("BEGIN IMMEDIATE")
        case "postgresql":
            connection.exec_driver_sql(f"SET LOCAL lock_timeout = '{PATIENCE_S:.0f}s'")
            connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({LOCK})")


def _are_up_to_date(connection: Connection) -> bool:
    if not inspect(connection).has_table("alembic_version"):
        return False
    version = connection.execute(text("SELECT version_num FROM alembic_version")).scalar()
    return version is not None and version >= NEWEST
