"""The local channel of a run: where its process listens, and how others of the same user ask it.

The address is one that only the run's own user can open, and a key proves it: a Unix socket and a
key file in a folder of mode 0700, or a named pipe on Windows. The name is a digest of the run
folder's path: the address of a Unix socket ends at about a hundred characters. Messages are small
JSON texts, never pickles. The threads here take no part in the run's time.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import AuthenticationError
from multiprocessing.connection import (
    Client,
    Connection,
    Listener,
    answer_challenge,
    deliver_challenge,
)
from pathlib import Path
from threading import Event, Lock, Thread, current_thread
from typing import Any

from station.clock import RealClock, boot_seconds
from station.control.status import read_status
from station.errors import InputError, StationError
from station.files.locks import is_held
from station.record.layout import EVENTS, LOCK
from station.record.run_state import SENTENCES
from station.safety.acknowledgement import APPLICATION, state_folder

MAX_ADDRESS = 100
"""Linux takes 107 bytes, macOS 103."""
PRIVATE_FOLDER, PRIVATE_FILE = 0o700, 0o600
OF_OTHERS = 0o077
KEY_BYTES = 32
PIPE = rf"\\.\pipe\{APPLICATION}-"


@dataclass(frozen=True)
class ChannelAddress:
    """The address of one run's channel, and the file that holds its key."""

    address: str
    family: str
    key_file: Path

    def prepare(self) -> bytes:
        """Make the folder, drop what a dead process left, and return a new key; raises OSError.

        Whoever comes here holds the lock of the run folder: what lies here is nobody's any more.
        """
        make_private(self.key_file.parent)
        self.remove()
        key = secrets.token_bytes(KEY_BYTES)
        handle = os.open(self.key_file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE_FILE)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            json.dump({"key": key.hex()}, file)
        return key

    def key(self) -> bytes | None:
        """Return the key of who listens; None where nobody of this user does."""
        try:
            if not is_private(self.key_file.parent):
                return None
            return bytes.fromhex(json.loads(self.key_file.read_text(encoding="utf-8"))["key"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def remove(self) -> None:
        """Remove the files."""
        for path in [self.key_file, *([Path(self.address)] if self.family == "AF_UNIX" else [])]:
            with suppress(OSError):
                path.unlink()


def places(run: Path) -> Iterator[ChannelAddress]:
    """Yield the places at which a run may listen, the best one first."""
    digest = hashlib.sha256(os.path.normcase(run.resolve()).encode()).hexdigest()[:16]
    for folder in folders():
        key_file = folder / f"{digest}.key"
        if sys.platform == "win32":
            yield ChannelAddress(PIPE + digest, "AF_PIPE", key_file)
            continue
        address = str(folder / f"{digest}.sock")
        if len(os.fsencode(address)) <= MAX_ADDRESS:
            yield ChannelAddress(address, "AF_UNIX", key_file)


def folders() -> Iterator[Path]:
    """Yield the folders for sockets and keys; a terminal without some variable finds them too."""
    if sys.platform != "win32":
        runtime = os.environ.get("XDG_RUNTIME_DIR")
        known = Path(f"/run/user/{os.getuid()}")
        for parent in dict.fromkeys([*([Path(runtime)] if runtime else []), known]):
            if parent.is_dir():
                yield parent / APPLICATION
    yield state_folder() / "control"
    if sys.platform != "win32":
        yield Path(tempfile.gettempdir()) / f"{APPLICATION}-{os.getuid()}"


def make_private(folder: Path) -> None:
    """Create a folder that only this user can open, or make it one; raises OSError."""
    folder.mkdir(mode=PRIVATE_FOLDER, parents=True, exist_ok=True)
    if sys.platform != "win32" and folder.lstat().st_uid == os.getuid() and not folder.is_symlink():
        folder.chmod(PRIVATE_FOLDER)
    if not is_private(folder):
        raise PermissionError(f"{folder} belongs to another user")


def is_private(folder: Path) -> bool:
    """Whether a folder is this user's and nobody else can open it; raises OSError."""
    if sys.platform == "win32":  # below the user's own profile, which others cannot open
        return folder.is_dir()
    facts = folder.lstat()
    own = stat.S_ISDIR(facts.st_mode) and facts.st_uid == os.getuid()
    return own and not facts.st_mode & OF_OTHERS


MAX_MESSAGE = 65536
BACKLOG = 8
LOOKS_EVERY_S = 0.1
"""Real time between two looks whether who asked is still there."""
LEAVES_WITHIN_S = 1.0
BROKEN = (OSError, EOFError, ValueError, AuthenticationError)


class Incoming:
    """One request: it is answered once, by whichever thread knows the answer."""

    def __init__(self, asked: str, details: Mapping[str, Any]) -> None:
        self.asked = asked
        self.details = details
        self.meanwhile: Mapping[str, Any] | None = None
        """What is answered at once where the answer takes its time."""
        self.withdrawn = False
        """Whether who asked has gone before there was an answer."""
        self.final: Mapping[str, Any] = {}
        self._answered = Event()
        self._lock = Lock()

    def answer(self, **outcome: Any) -> None:
        """Give the answer; the first one counts."""
        with self._lock:
            if not self._answered.is_set():
                self.final = outcome
                self._answered.set()

    def wait(self, seconds: float) -> bool:
        """Wait in real time; whether there is an answer."""
        return self._answered.wait(seconds)


class Channel:
    """Listen for requests to the run of a folder until `close`; `take` gets each of them.

    Raises OSError where the system gives no place to listen at.
    """

    def __init__(self, folder: Path, take: Callable[[Incoming], None]) -> None:
        self._take = take
        self._closed = False
        self._lock = Lock()
        self._talks: dict[Thread, Incoming | None] = {}
        self.place, self._key, self._listener = listening(folder)
        self._thread = Thread(target=self._accept, name="control", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Listen no more, and remove the files; who still waits learns that the run ends."""
        self._closed = True
        with suppress(*BROKEN):  # wakes the thread that waits for somebody to come
            Client(self.place.address, self.place.family).close()
        self._thread.join(LEAVES_WITHIN_S)
        # The disk below need not be the run's: one that hangs keeps no run from its last words.
        removing = Thread(target=self._remove, name="control-remove", daemon=True)
        with suppress(RuntimeError):
            removing.start()
            removing.join(LEAVES_WITHIN_S)
        with self._lock:
            talks = dict(self._talks)
        for thread, incoming in talks.items():
            if incoming is not None:
                incoming.answer(outcome="ended", said="the run ends first")
            thread.join(LEAVES_WITHIN_S)

    def _remove(self) -> None:
        with suppress(OSError):
            self._listener.close()  # removes its file
        self.place.remove()

    def _accept(self) -> None:
        while not self._closed:
            try:
                connection = self._listener.accept()
            except BROKEN:
                Event().wait(LOOKS_EVERY_S)  # such as no file handle left: others may become free
                continue
            if self._closed:
                connection.close()
                return
            thread = Thread(target=self._talk, args=(connection,), name="control-talk", daemon=True)
            with self._lock:
                self._talks[thread] = None
            thread.start()

    def _talk(self, connection: Connection) -> None:
        try:
            with connection:
                incoming = self._proven(connection)
                with self._lock:
                    self._talks[current_thread()] = incoming
                self._take(incoming)
                answer_in_time(connection, incoming)
        except BROKEN:  # who asked has gone, or is not who may ask
            return
        finally:
            with self._lock:
                self._talks.pop(current_thread(), None)

    def _proven(self, connection: Connection) -> Incoming:
        """Return the request of somebody who has the key."""
        deliver_challenge(connection, self._key)
        answer_challenge(connection, self._key)
        request = json.loads(connection.recv_bytes(MAX_MESSAGE))
        if not isinstance(request, dict):
            raise ValueError("no request")
        return Incoming(str(request.pop("ask", None)), request)


def answer_in_time(connection: Connection, incoming: Incoming) -> None:
    """Send the answer once there is one; who leaves before has withdrawn the request."""
    if not incoming.wait(0.0) and incoming.meanwhile is not None:
        send(connection, incoming.meanwhile, final=False)
    while not incoming.wait(LOOKS_EVERY_S):
        if connection.poll(0.0):  # nothing more is to come, so this is the end of the connection
            incoming.withdrawn = True
            return
    send(connection, incoming.final, final=True)


def send(connection: Connection, answer: Mapping[str, Any], *, final: bool) -> None:
    """Send a message as JSON text."""
    text = json.dumps({"final": final, **answer}, ensure_ascii=False)
    connection.send_bytes(text.encode())


def listening(folder: Path) -> tuple[ChannelAddress, bytes, Listener]:
    """Return the first place that the system gives, its key, and who listens there."""
    refused = OSError("there is no folder that only this user can open")
    for place in places(folder):
        try:
            key = place.prepare()
            listener = Listener(place.address, place.family, BACKLOG)
            if place.family == "AF_UNIX":
                Path(place.address).chmod(PRIVATE_FILE)
        except OSError as error:
            refused = error
            place.remove()
            continue
        return place, key, listener
    raise refused


LISTENS_WITHIN_S = 2.0
"""A run that has just got its folder needs a moment until it listens."""
ANSWER_LOOKS_EVERY_S = 0.05
ANSWERS_WITHIN_S = 5.0
"""Until it says anything at all; the last word may take a unit of work."""
BENCH_UNKNOWN = "nobody has read its bench back as safe: look at it, switch off by hand what is on"
LISTENS_TO_NOBODY = (
    "a process is at work on it but does not listen here: it is past its last step, or was "
    "started by another user or on another computer; use Ctrl-C in its own terminal"
)


class NotRunning(InputError):
    """A run that no process is at work on."""


class NoAnswer(StationError):
    """A run whose process does not answer: it is stopped, hangs, has died or is past its steps."""


def ask(
    folder: Path,
    request: str,
    timeout_s: float | None = ANSWERS_WITHIN_S,
    *,
    meanwhile: Callable[[dict[str, Any]], None] | None = None,
    waiting: Callable[[], None] | None = None,
    details: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Ask `pause`, `go-on`, `abort`, `status`, `live` or `answer` and return the last answer.

    `details` go with the request: the `id` of a prompt and the `text` of its answer.
    `meanwhile` gets what is said at once where that takes longer than `ANSWERS_WITHIN_S` allows,
    and `waiting` is then called now and again. Without `timeout_s` the last answer may take any
    time. Who leaves without it has taken the request back.

    Raises NotRunning, and NoAnswer where there is a process that does not answer.
    """
    connection, key = connected(folder)
    with connection:
        try:
            prove(folder, connection, key)
            connection.send_bytes(json.dumps({"ask": request, **(details or {})}).encode())
            answer = received(folder, connection, ANSWERS_WITHIN_S)
            if answer.get("final"):
                return answer
            if meanwhile is not None:
                meanwhile(answer)
            return received(folder, connection, timeout_s, waiting)
        except AuthenticationError as error:
            raise StationError(f"{folder}: the run's process refuses the key: {error}") from error
        except (EOFError, OSError) as error:
            raise NoAnswer(
                f"{folder}: the run's process ended before it answered; `station status {folder}` "
                "shows its state"
            ) from error


def go_on(folder: Path) -> bool:
    """Let a paused run go on; False where there is none: not running, or not paused."""
    try:
        return ask(folder, "go-on").get("outcome") == "goes-on"
    except NotRunning:
        return False


def connected(folder: Path) -> tuple[Connection, bytes]:
    """Return a connection to the run's process, not proven yet, and the key to prove it with."""
    if not (folder / EVENTS).is_file():
        raise InputError(f"{folder} is no run folder: it holds no {EVENTS}")
    until_s = boot_seconds() + LISTENS_WITHIN_S
    while True:
        # A folder is there a moment before the run that has it locks it and writes its first event.
        begins = not (folder / EVENTS).stat().st_size and boot_seconds() < until_s
        if not begins and not is_held(folder / LOCK):
            raise NotRunning(not_running(folder))
        for place in places(folder):
            key = place.key()
            if key is None:
                continue
            try:
                return Client(place.address, place.family), key
            except OSError:  # left by a dead process, or about to be replaced
                continue
        if boot_seconds() > until_s:
            raise NoAnswer(f"{folder}: {LISTENS_TO_NOBODY}")
        RealClock().sleep(ANSWER_LOOKS_EVERY_S)


def not_running(folder: Path) -> str:
    """Say how a run stands that no process is at work on, and what to do."""
    status = read_status(folder)
    state = status.state
    if state == "finished":
        return f"{folder}: the run is not running: it is finished"
    state_text = SENTENCES[state].partition(":")[0]
    bench = "" if status.bench_safe else f"; {BENCH_UNKNOWN}"
    again = f"`station resume {folder}` resumes it"
    return f"{folder}: the run is not running ({state_text}){bench}; {again}"


def prove(folder: Path, connection: Connection, key: bytes) -> None:
    """Show the key, and ask the other side to show that it has it too."""
    if not connection.poll(ANSWERS_WITHIN_S):
        raise NoAnswer(silent(folder))
    answer_challenge(connection, key)
    deliver_challenge(connection, key)


def received(
    folder: Path,
    connection: Connection,
    timeout_s: float | None,
    waiting: Callable[[], None] | None = None,
) -> dict[str, Any]:
    """Return the next message; raises StationError when none comes in time."""
    until_s = None if timeout_s is None else boot_seconds() + timeout_s
    while not connection.poll(ANSWER_LOOKS_EVERY_S):
        if until_s is not None and boot_seconds() > until_s:
            raise NoAnswer(silent(folder))
        if waiting is not None:
            waiting()
    answer: dict[str, Any] = json.loads(connection.recv_bytes())
    return answer


def silent(folder: Path) -> str:
    """Say that the run's process does not answer, and what to do."""
    return (
        f"{folder}: the run's process does not answer: it is stopped, or hangs; "
        "go to the bench and look at it"
    )
