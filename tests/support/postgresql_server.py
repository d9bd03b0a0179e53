"""A PostgreSQL server of the tests: begun in a temporary folder, on a Unix socket alone.

Root may not run the server: where the tests are root's, `nobody` does. Its texts are sorted as a
dictionary sorts them, unlike bytes: an order that the station relies on shows up as one.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

REQUIRED = "STATION_POSTGRESQL_REQUIRED"
"""Set where a missing server is a failure."""
USER, SOCKETS = "lab", "sockets"
TRUSTING = ("-A", "trust", "-E", "UTF8", "--no-sync")
DICTIONARY = ("--locale=C.UTF-8", "--locale-provider=icu", "--icu-locale=en")
SETTINGS = ("listen_addresses=", "fsync=off", "synchronous_commit=off", "full_page_writes=off")
"""What such a server need not survive is the computer's end."""
ANSWERS_WITHIN_S = 60


class NoServerError(Exception):
    """PostgreSQL is not installed here."""


class PostgresqlServer:
    """A server that answers; whoever asks gets an empty database by its SQLAlchemy URL."""

    def __init__(self, folder: Path, process: subprocess.Popen[bytes]) -> None:
        self.folder, self.process = folder, process
        self._count = 0

    def new_database(self) -> str:
        """Make a database, and return its URL."""
        import psycopg

        self._count += 1
        name = f"history_{self._count}"
        with psycopg.connect(self._told("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}")
        return f"postgresql+psycopg://{USER}@/{name}?host={self.folder / SOCKETS}"

    def _told(self, database: str) -> str:
        return f"host={self.folder / SOCKETS} user={USER} dbname={database}"


def programs() -> Path:
    """Return the folder of the server's programs; raises NoServerError where there is none."""
    there = shutil.which("postgres")
    debian = sorted(Path("/usr/lib/postgresql").glob("*/bin/postgres"))
    for server in (*([Path(there).resolve()] if there else []), *reversed(debian)):
        if (server.parent / "initdb").exists():
            return server.parent
    raise NoServerError("there is no PostgreSQL server: install Debian's postgresql")


@contextmanager
def postgresql_server() -> Iterator[PostgresqlServer]:
    """Yield a server, and end it; raises NoServerError."""
    where = programs()
    # Beside the folders of pytest, into which nobody but their owner may look.
    folder = Path(tempfile.mkdtemp(prefix="postgresql-"))
    process = None
    who: dict[str, Any] = {}
    try:
        if os.geteuid() == 0:
            import pwd

            nobody = pwd.getpwnam("nobody")
            who = {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []}
            os.chown(folder, nobody.pw_uid, nobody.pw_gid)
        data = folder / "data"
        made = subprocess.run(
            [where / "initdb", "-D", data, "-U", USER, *TRUSTING, *DICTIONARY],
            cwd=folder,
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
            **who,
        )
        assert made.returncode == 0, made.stderr
        options = [word for setting in SETTINGS for word in ("-c", setting)]
        (folder / SOCKETS).mkdir()
        if who:
            os.chown(folder / SOCKETS, who["user"], who["group"])
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(
                [where / "postgres", "-D", data, "-k", folder / SOCKETS, *options],
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                **who,
            )
        server = PostgresqlServer(folder, process)
        _await(server)
        yield server
    finally:
        if process is not None:
            process.send_signal(signal.SIGINT)  # at once, also with clients
            process.wait(timeout=ANSWERS_WITHIN_S)
        shutil.rmtree(folder, ignore_errors=True)


def _await(server: PostgresqlServer) -> None:
    import psycopg

    ends_by_s = time.monotonic() + ANSWERS_WITHIN_S
    while True:
        try:
            psycopg.connect(server._told("postgres")).close()
            return
        except psycopg.OperationalError:
            log = (server.folder / "log").read_text(encoding="utf-8", errors="replace")
            assert server.process.poll() is None, log
            assert time.monotonic() < ends_by_s, log
            time.sleep(0.05)


@contextmanager
def server_or_skip() -> Iterator[PostgresqlServer]:
    """Yield a server for tests, or skip them where there is none."""
    import pytest

    if sys.platform == "win32":
        pytest.skip("the tests start PostgreSQL on a Unix socket")
    try:
        programs()
    except NoServerError as error:
        if REQUIRED in os.environ:
            raise
        pytest.skip(str(error))
    with postgresql_server() as server:
        yield server
