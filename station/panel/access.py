"""Who may do what on the panel: tokens, roles, where a request comes from, and how large it is."""

from __future__ import annotations

import hmac
import secrets
from dataclasses import dataclass, field
from typing import Literal

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

Role = Literal["operator", "engineer"]
COOKIE = "station-panel-"
"""And the port: a browser keeps one set of cookies for every port of a computer."""
LARGEST_REQUEST = 65536
GUESS_EVERY_S, MAX_WAIT_S = 1.0, 10.0
MAX_PEERS = 1000
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
OPEN_PATHS = ("/login", "/static/")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: "
    "blob:; connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
"""Plotly writes styles into the page; scripts come from files alone."""


@dataclass
class Access:
    """The tokens of the roles, and who has shown one. Without tokens everybody is an operator.

    `hosts` are the names by which the panel may be asked for, as a browser writes them.
    """

    hosts: tuple[str, ...]
    tokens: dict[Role, str] = field(default_factory=dict)
    _sessions: dict[str, Role] = field(default_factory=dict)

    def role_of(self, connection: HTTPConnection) -> Role | None:
        """Return the role of who asks; None where a token is still to be shown."""
        session = self._sessions.get(connection.cookies.get(cookie_of(connection), ""))
        if session is not None:
            return session
        return None if "operator" in self.tokens else "operator"

    def log_in(self, token: str) -> tuple[str, Role] | None:
        """Return a new session, and its role, for a token; None for a wrong one."""
        # Every token is compared, so that the time says nothing.
        fitting = [
            role
            for role, own in self.tokens.items()
            if hmac.compare_digest(own.encode(), token.encode(errors="surrogatepass"))
        ]
        if not fitting:
            return None
        session = secrets.token_urlsafe(32)
        self._sessions[session] = fitting[0]
        return session, fitting[0]


class Turns:
    """When each computer's next token is looked at: one a second after a wrong one of its own.

    Its guesses queue up behind one another, and behind nobody else's. The computers that came last
    are remembered, and no more than `MAX_PEERS`.
    """

    def __init__(self) -> None:
        self._free_s: dict[str, float] = {}

    def take(self, peer: str, now_s: float) -> float | None:
        """Return the seconds until a token is looked at, None where too many wait already."""
        wait_s = max(self._free_s.get(peer, now_s) - now_s, 0.0)
        if wait_s > MAX_WAIT_S:
            return None
        self._free_s.pop(peer, None)
        self._free_s[peer] = now_s + wait_s + GUESS_EVERY_S
        if len(self._free_s) > MAX_PEERS:
            del self._free_s[next(iter(self._free_s))]
        return wait_s

    def was_right(self, peer: str) -> None:
        """Give the turn of a right token back: the next one need not wait for it."""
        if peer in self._free_s:
            self._free_s[peer] -= GUESS_EVERY_S


def cookie_of(connection: HTTPConnection) -> str:
    """Return the name of the cookie that holds a session of this panel."""
    return COOKIE + (connection.headers.get("host", "").rpartition(":")[2] or "80")


def peer_of(connection: HTTPConnection) -> str:
    """Return the address of the computer that asks."""
    return connection.client.host if connection.client else "an unknown address"


class Guard:
    """Refuse what the panel does not answer, before any page or action is reached."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it in one sentence."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        refused = self._refused(scope, headers)
        if refused is not None:
            status, sentence = refused
            await PlainTextResponse(sentence, status)(scope, receive, send)
            return

        async def send_with_policy(message: dict[str, object]) -> None:
            if message["type"] == "http.response.start":
                own = [
                    (b"content-security-policy", POLICY.encode()),
                    (b"x-content-type-options", b"nosniff"),
                    (b"referrer-policy", b"no-referrer"),
                    (b"cache-control", b"no-store"),
                ]
                given = list(message.get("headers", []))  # type: ignore[call-overload]
                names = {name.lower() for name, _ in given}
                message["headers"] = [*given, *(header for header in own if header[0] not in names)]
            await send(message)

        await self._app(scope, receive, send_with_policy)  # type: ignore[arg-type]

    def _refused(self, scope: Scope, headers: Headers) -> tuple[int, str] | None:
        """Return status and sentence of a request that is refused."""
        host = headers.get("host", "")
        # The address at which it came in is the panel's own, whatever it listens at.
        came_in = str((scope.get("server") or ("",))[0])
        names = {*self._access.hosts, f"[{came_in}]" if ":" in came_in else came_in}
        if not {host.rpartition(":")[0], host} & names:
            return 421, f"this panel does not answer as '{host[:100]}'"
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return 405, "the panel answers GET and POST"
        path = scope["path"]
        if scope["method"] == "POST":
            if headers.get("origin") not in (f"http://{host}", f"https://{host}"):
                return 403, "an action comes from a page of this panel, from no other place"
            if not headers.get("content-type", "").startswith("application/json"):
                return 415, "an action is JSON"
            length = headers.get("content-length", "")
            if not length.isdigit() or int(length) > LARGEST_REQUEST:
                return 413, f"an action states its length, {LARGEST_REQUEST} bytes at most"
        if path.startswith(OPEN_PATHS):
            return None
        if self._access.role_of(HTTPConnection(scope)) is None:
            if scope["method"] == "GET" and not path.startswith("/api/"):
                return None if path == "/" else (401, "log in first: open the panel's first page")
            return 401, "log in first: open the panel's first page"
        return None
