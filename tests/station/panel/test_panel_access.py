"""Who may do what on the panel, and that nothing outside the runs is read."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import urllib.request
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from command_line import station_command
from panel_server import Served, free_port, panel
from starlette.types import ASGIApp

from station.cli.panel import names_of, read_tokens, serve_panel
from station.cli.starting import DetachedRuns
from station.clock import boot_seconds
from station.errors import InputError
from station.panel.access import GUESS_EVERY_S, LARGEST_REQUEST, MAX_PEERS, Access, Turns
from station.panel.app import Panel
from station.record.layout import EVENTS

WANTED = {"plan": "rlg-magnetic-sensitivity", "bench": "sim", "serial": "SN-1", "operator": ""}
OPERATOR, ENGINEER = "operator-token-1", "engineer-token-2"


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, one_axis_run: Path) -> Iterator[Served]:
    """A panel without tokens, on the folder of a finished run."""
    (one_axis_run.parent / "secret.txt").write_text("secret", encoding="utf-8")
    with panel(one_axis_run.parent) as one:
        yield one


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A panel that asks for a token."""
    tokens = {"operator": OPERATOR, "engineer": ENGINEER}
    with panel(tmp_path_factory.mktemp("guarded"), tokens) as one:  # type: ignore[arg-type]
        yield one


def test_the_first_page_lists_benches_plans_and_runs(served: Served, one_axis_run: Path) -> None:
    status, text = served.get("/api/home")
    data = json.loads(text)
    assert status == 200 and data["role"] == "operator"
    assert {one["name"] for one in data["benches"]} >= {"sim", "sim-alternate"}
    (run,) = (one for one in data["runs"] if one["run"] == one_axis_run.name)
    assert (run["running"], run["verdict"] is None) == (False, False)
    assert json.loads(served.get("/api/home?search=no-such-serial")[1])["runs"] == []


@pytest.mark.parametrize("origin", ["http://evil.example", "null", ""])
def test_an_action_from_another_page_is_refused(served: Served, origin: str) -> None:
    status, text = served.post("/api/start", WANTED, Origin=origin)
    assert status == 403, text
    assert not any(path.name.endswith("SN-1-2") for path in served.runs.iterdir())


def test_only_the_panels_own_names_are_answered(served: Served) -> None:
    assert served.get("/", Host="rebound.example")[0] == 421


@pytest.mark.parametrize(
    "path",
    [
        "/run/..%2f..",
        "/run/secret.txt",
        "/api/run/../results",
        "/api/run/..%2f..%2fetc/report",
        "/static/..%2fapp.py",
        "/static/../../app.py",
        "/secret.txt",
    ],
)
def test_nothing_outside_the_runs_is_read(served: Served, path: str) -> None:
    status, text = served.get(path)
    assert status in (404, 409), text
    assert "secret" not in text and "import" not in text


def test_an_action_has_a_size_and_a_form(served: Served) -> None:
    assert served.post("/api/look", "x" * LARGEST_REQUEST)[0] == 413
    assert served.post("/api/look", ["no mapping"])[0] == 409
    assert served.post("/api/look", WANTED, **{"Content-Type": "text/plain"})[0] == 415
    status, text = served.post("/api/look", {**WANTED, "plan": "../../etc/passwd"})
    assert status == 409 and "no plan of the name" in text


def test_a_look_says_what_the_run_would_do(served: Served) -> None:
    status, text = served.post("/api/look", WANTED)
    data = json.loads(text)
    assert status == 200 and data["faults"] == []
    assert data["steps"][0]["step"] == "S1" and data["expected_s"] > 600
    assert any("coil_supply.x" in json.dumps(step["set_points"]) for step in data["steps"])


def test_an_operator_starts_released_plans_alone(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    plans = tmp_path / "config" / "plans"
    plans.mkdir(parents=True)
    (plans / "own.yaml").write_text(
        "plan: 1\nextends: rlg-magnetic-sensitivity\ntitle: not released\n", encoding="utf-8"
    )
    data = json.loads(served.post("/api/look", {**WANTED, "plan": "own"})[1])
    assert "is not released" in data["faults"][0]
    assert served.post("/api/start", {**WANTED, "plan": "own"})[0] == 409


def test_nothing_is_shown_before_a_token(guarded: Served) -> None:
    assert guarded.get("/")[0] == 200
    assert guarded.get("/api/home")[0] == 401
    assert guarded.post("/api/look", WANTED)[0] == 401
    assert guarded.post("/login", {"token": "operator-token-9"})[0] == 403


@pytest.mark.parametrize(("token", "role"), [(OPERATOR, "operator"), (ENGINEER, "engineer")])
def test_a_token_gives_its_role(guarded: Served, token: str, role: str) -> None:
    request = urllib.request.Request(
        guarded.url + "/login",
        json.dumps({"token": token}).encode(),
        {"Origin": guarded.url, "Content-Type": "application/json"},
    )
    with urllib.request.urlopen(request) as answer:
        cookie = answer.headers["Set-Cookie"]
        assert json.loads(answer.read()) == {"role": role}
    assert cookie.startswith(f"station-panel-{guarded.url.rpartition(':')[2]}=")
    assert "HttpOnly" in cookie and "SameSite=strict" in cookie and token not in cookie
    status, text = guarded.get("/api/home", Cookie=cookie.partition(";")[0])
    assert status == 200 and json.loads(text)["role"] == role


def test_the_panel_is_not_opened_to_others_without_tokens(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="people must log in"):
        serve_panel("0.0.0.0", 8642, tmp_path, None)


def test_a_file_of_tokens_that_others_can_read_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "tokens.yaml"
    file.write_text(f"operator: {OPERATOR}\n", encoding="utf-8")
    file.chmod(0o644)
    with pytest.raises(InputError, match="chmod 600"):
        read_tokens(file)
    file.chmod(0o600)
    assert read_tokens(file) == {"operator": OPERATOR}


def test_a_panel_is_asked_for_as_browsers_write_names(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "LAB-PC")
    assert names_of("fe80::7") == ("[fe80::7]", "lab-pc")
    assert "localhost" in names_of("127.0.0.1")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("engineer: engineer-token-2\n", "write `operator"),
        ("operator: short\n", "characters or more"),
        ("operator: operator-token-1\nengineer: operator-token-1\n", "different tokens"),
        ("operator: operator-token-1\nadmin: operator-token-3\n", "write `operator"),
    ],
)
def test_a_file_of_tokens_that_protects_nobody_is_refused(
    text: str, what: str, tmp_path: Path
) -> None:
    file = tmp_path / "tokens.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=what):
        read_tokens(file)


def test_a_picture_of_a_prompt_is_read_and_nothing_beside_it(tmp_path: Path) -> None:
    run = tmp_path / "runs" / "one"
    run.mkdir(parents=True)
    started = {"event": "run-started", "t": 0.0, "procedure": "rlg-magnetic-sensitivity"}
    (run / EVENTS).write_text(json.dumps(started) + "\n", encoding="utf-8")
    with panel(tmp_path / "runs") as served:
        status, text = served.get("/api/run/one/picture/mounting.svg")
        assert status == 200
        assert "field probe" in text
        for name in ("..%2F__init__.py", "%2e%2e%2f__init__.py", "other.svg", "MOUNTING.SVG"):
            assert served.get(f"/api/run/one/picture/{name}")[0] == 404
        started["procedure"] = "../../x"
        (run / EVENTS).write_text(json.dumps(started) + "\n", encoding="utf-8")
        assert served.get("/api/run/one/picture/mounting.svg")[0] == 404


def test_the_panel_ends_although_a_browser_listens(one_axis_run: Path) -> None:
    port = free_port()
    options = ("--output", one_axis_run.parent, "--port", str(port))
    process = subprocess.Popen(station_command("panel", *options), stderr=subprocess.PIPE)
    assert process.stderr is not None
    assert b"http" in process.stderr.readline()
    url = f"http://127.0.0.1:{port}/api/run/{one_axis_run.name}/events"
    until_s = boot_seconds() + 60.0
    while True:
        try:
            listening = urllib.request.urlopen(url, timeout=60)
            break
        except OSError:
            assert boot_seconds() < until_s
    with listening:
        assert listening.readline().startswith(b"retry: ")
        process.terminate()
        process.wait(60.0)
    process.stderr.close()


def test_guesses_of_a_token_are_taken_one_by_one(guarded: Served) -> None:
    began_s, guesses = boot_seconds(), 3
    asked = [Thread(target=guarded.post, args=("/login", {"token": "x"})) for _ in range(guesses)]
    for one in asked:
        one.start()
    for one in asked:
        one.join()
    assert boot_seconds() - began_s >= guesses * 0.99


def test_wrong_tokens_delay_the_computer_alone_that_sent_them(guarded: Served) -> None:
    asked = [Thread(target=logged_in_from, args=(guarded, "127.0.0.2", "x")) for _ in range(3)]
    for one in asked:
        one.start()
    began_s = boot_seconds()
    assert logged_in_from(guarded, "127.0.0.3", OPERATOR) == 200
    assert logged_in_from(guarded, "127.0.0.3", ENGINEER) == 200
    assert any(one.is_alive() for one in asked), "it was let in before the guesses were answered"
    for one in asked:
        one.join()
    guessed_s = boot_seconds() - began_s
    assert guessed_s >= 3 * GUESS_EVERY_S * 0.95
    began_s = boot_seconds()
    assert logged_in_from(guarded, "127.0.0.2", OPERATOR) == 200
    assert boot_seconds() - began_s < guessed_s / 3, "right tokens wait for nothing"


def logged_in_from(panel: Served, address: str, token: str) -> int:
    """Show a token from an address of this computer; return the status of the answer."""
    host, _, port = panel.url.removeprefix("http://").partition(":")
    connection = HTTPConnection(host, int(port), timeout=60, source_address=(address, 0))
    headers = {"Origin": panel.url, "Content-Type": "application/json"}
    connection.request("POST", "/login", json.dumps({"token": token}), headers)
    status = connection.getresponse().status
    connection.close()
    return status


def test_one_computer_that_guesses_waits_longer_and_is_then_refused_and_few_are_remembered() -> (
    None
):
    turns, now_s = Turns(), 100.0
    waits = [turns.take("192.0.2.1", now_s) for _ in range(13)]
    assert waits[:11] == [float(n) for n in range(11)]
    assert waits[11:] == [None, None]
    assert turns.take("192.0.2.2", now_s) == 0.0
    turns.was_right("192.0.2.2")
    assert turns.take("192.0.2.2", now_s) == 0.0
    for number in range(MAX_PEERS):
        turns.take(f"peer {number}", now_s)
    assert turns.take("192.0.2.1", now_s) == 0.0


def test_a_panel_at_every_address_answers_at_the_one_it_is_asked(tmp_path: Path) -> None:
    app = Panel(tmp_path, Access(("lab-3",), {}), DetachedRuns(tmp_path)).app()
    for host, server, status in (
        ("192.0.2.7:80", "192.0.2.7", 200),
        ("[2001:db8::7]:80", "2001:db8::7", 200),
        ("lab-3:80", "192.0.2.7", 200),
        ("192.0.2.8:80", "192.0.2.7", 421),
    ):
        scope = {"type": "http", "method": "GET", "path": "/", "query_string": b""}
        scope |= {"headers": [(b"host", host.encode())], "server": (server, 80)}
        scope["asgi"] = {"version": "3.0", "spec_version": "2.4"}  # no wait for a disconnect
        assert status_of(app, scope) == status, host


def status_of(app: ASGIApp, scope: dict[str, Any]) -> int:
    """Return the status that an application answers to a request."""
    said: list[Any] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: Any) -> None:
        said.append(message)

    asyncio.run(app(scope, receive, send))
    return int(said[0]["status"])


def test_a_port_that_is_taken_is_named_before_the_panel_says_where_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match="cannot listen at"):
            serve_panel("127.0.0.1", port, tmp_path, None)
    assert "http://" not in capsys.readouterr().err
