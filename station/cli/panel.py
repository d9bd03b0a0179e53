"""`station panel`: the operator panel in a browser."""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from station.console import tell
from station.errors import InputError

if TYPE_CHECKING:
    from station.panel.access import Role

LOOPBACK = ("127.0.0.1", "localhost", "::1")
VIEWERS_LEAVE_WITHIN_S = 1
"""A browser listens for as long as the panel lives: its end waits for none."""
FEWEST_CHARACTERS = 12
OF_OTHERS = 0o077
ROLES: tuple[Role, ...] = ("operator", "engineer")


def serve_panel(host: str, port: int, runs: Path, tokens_file: Path | None) -> None:
    """Serve the panel until Ctrl-C; raises InputError where it may not, or cannot, listen."""
    try:
        import uvicorn

        from station.cli.starting import DetachedRuns
        from station.panel.access import Access
        from station.panel.app import Panel
    except ImportError as error:
        raise InputError(
            f"the panel needs packages that are not installed ({error.name}); "
            "`pip install inertial-station[panel]` installs them"
        ) from error
    tokens: dict[Role, str] = {} if tokens_file is None else read_tokens(tokens_file)
    if host not in LOOPBACK and "operator" not in tokens:
        raise InputError(
            f"{host} can be reached from other computers, so people must log in: write a file of "
            "tokens, `operator: …` and `engineer: …`, and name it with --tokens"
        )
    shown = f"[{host}]" if ":" in host else host
    app = Panel(runs, Access(names_of(host), tokens), DetachedRuns(runs)).app()
    try:
        listener = socket.create_server(
            (host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET
        )
    except OSError as error:
        raise InputError(
            f"cannot listen at {shown}:{port} ({error.strerror or error}); choose another --port"
        ) from error
    tell(f"panel: http://{shown}:{port}/ (Ctrl-C ends it; runs go on without it)")
    if host not in LOOPBACK:
        tell("the panel is open to other computers, without encryption: keep it in the laboratory")
    config = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        timeout_graceful_shutdown=VIEWERS_LEAVE_WITHIN_S,
    )
    with listener, suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listener])


def names_of(host: str) -> tuple[str, ...]:
    """Return the names by which a browser asks for a panel that listens at an address."""
    if host in LOOPBACK:
        return ("127.0.0.1", "localhost", "[::1]")
    return (f"[{host}]" if ":" in host else host.lower(), socket.gethostname().lower())


def read_tokens(path: Path) -> dict[Role, str]:
    """Return the tokens of the roles in a YAML file; raises InputError."""
    from station.files.yaml.reading import read_yaml

    data = read_yaml(path).data
    unknown = set(data) - set(ROLES)
    if unknown or "operator" not in data:
        raise InputError(f"{path}: write `operator: …` and, where wished, `engineer: …`")
    words: dict[Role, str] = {role: str(data[role]) for role in ROLES if role in data}
    if any(len(word) < FEWEST_CHARACTERS for word in words.values()):
        raise InputError(f"{path}: a token has {FEWEST_CHARACTERS} characters or more")
    if len(set(words.values())) < len(words):
        raise InputError(f"{path}: the roles have different tokens")
    if os.name == "posix" and path.stat().st_mode & OF_OTHERS:
        raise InputError(f"{path}: others can read the tokens; `chmod 600 {path}`")
    return words
