"""A session of tests is one thing that ends as one: the kernel ends all of it, whatever ends it.

Where Linux allows it pytest runs in a process and a mount namespace of its own, with its own
`/proc` and its own empty memory disk over the folder of locks, `/dev/shm` and the temporary
folders. Its first process reaps, passes SIGTERM and SIGINT on, and ends when pytest does or when
the process that was started from the shell is gone. With the first process of a namespace the
kernel ends all others in it, guardians and simulators included, and drops its mounts.
"""

from __future__ import annotations

import ctypes
import os
import select
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from station.instruments.instrument_locks import PLACES

INSIDE = "STATION_TESTS_INSIDE"
"""In the environment of whatever a session starts: the process namespace that it runs in."""
NEW_MOUNTS, NEW_PROCESSES, NEW_USERS = 0x00020000, 0x20000000, 0x10000000
BIND, PRIVATE = 0x1000, 0x4000 | 1 << 18
SET_PARENT_DEATH_SIGNAL = 1
ENDS_WITHIN_S = 8.0
"""From Ctrl-C or SIGTERM until what has not ended is killed."""
READY = b"ready"


def is_inside() -> bool:
    """Whether this process belongs to a session in namespaces of its own."""
    return os.environ.get(INSIDE) == namespace_of_processes()


def namespace_of_processes() -> str:
    return str(Path("/proc/self/ns/pid").readlink()) if sys.platform == "linux" else ""


def run_inside(command: Sequence[str], keep: Sequence[Path], *, patient: bool) -> int | None:
    """Do a command in namespaces of its own; return its exit code, None where none can be had.

    What lies in the folders `keep` stays visible. `patient`: Ctrl-C sets no limit of time, since
    somebody sits in a debugger.
    """
    hidden = folders_to_hide(keep)
    if sys.platform != "linux" or not hidden:
        return None
    lifeline, held = os.pipe()
    state, reports = os.pipe()
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    if (outside := os.fork()) == 0:
        os.close(held)
        os.close(state)
        _exit_with(lambda: _enter(command, hidden, keep, lifeline, reports, patient))
    os.close(lifeline)
    os.close(reports)
    with os.fdopen(state, "rb") as reported:
        ready = reported.read() == READY
    if not ready:
        os.waitpid(outside, 0)
        os.close(held)
        return None
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number in handlers:
        signal.signal(number, lambda received, _: os.write(held, bytes([received])) and None)
    try:
        _, status = os.waitpid(outside, 0)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        os.close(held)
    return _exit_code(status)


def folders_to_hide(keep: Sequence[Path]) -> list[Path]:
    """Return the folders that a session gets empty ones of; none in which something kept lies."""
    places = {os.path.realpath(place) for place in (tempfile.gettempdir(), "/dev/shm", *PLACES)}
    wanted = [Path(place) for place in sorted(places) if Path(place).is_dir()]
    outer = [place for place in wanted if not set(place.parents) & set(wanted)]
    return [place for place in outer if place not in keep]


def _exit_with(act: object) -> None:
    code = 70
    try:
        code = act()  # type: ignore[operator]
    finally:
        os._exit(code)


def _enter(
    command: Sequence[str],
    hidden: Sequence[Path],
    keep: Sequence[Path],
    lifeline: int,
    reports: int,
    patient: bool,
) -> int:
    """Make the namespaces, and wait for the first process in them."""
    libc = ctypes.CDLL(None, use_errno=True)
    _checked(libc.prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL))
    user, group = os.geteuid(), os.getegid()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    flags = NEW_MOUNTS | NEW_PROCESSES | (NEW_USERS if user else 0)
    _checked(libc.unshare(flags))
    if user:
        Path("/proc/self/setgroups").write_text("deny", encoding="ascii")
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1", encoding="ascii")
        Path("/proc/self/gid_map").write_text(f"{group} {group} 1", encoding="ascii")
    if (first := os.fork()) == 0:
        _checked(libc.prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL))
        _hide(libc, hidden, keep)
        os.write(reports, READY)
        os.close(reports)
        temporary = Path(os.path.realpath(tempfile.gettempdir()))
        own = str(temporary if temporary in hidden else hidden[0])
        environment = {**os.environ, INSIDE: namespace_of_processes(), "TMPDIR": own}
        _exit_with(lambda: _first_process(command, environment, lifeline, patient))
    os.close(reports)
    return _exit_code(os.waitpid(first, 0)[1])


def _hide(libc: ctypes.CDLL, hidden: Sequence[Path], keep: Sequence[Path]) -> None:
    """Mount an empty memory disk over each folder, and again in it what is kept."""
    here = Path.cwd()
    seen = {path: os.open(path, os.O_PATH) for path in keep if set(path.parents) & set(hidden)}
    _checked(libc.mount(b"none", b"/", None, PRIVATE, None))
    _checked(libc.mount(b"proc", b"/proc", b"proc", 0, None))
    for place in hidden:
        _checked(libc.mount(b"tmpfs", bytes(place), b"tmpfs", 0, b"mode=1777"))
    for path, opened in seen.items():
        path.mkdir(parents=True, exist_ok=True)
        _checked(libc.mount(f"/proc/self/fd/{opened}".encode(), bytes(path), None, BIND, None))
        os.close(opened)
    os.chdir(here)


def _first_process(
    command: Sequence[str], environment: dict[str, str], lifeline: int, patient: bool
) -> int:
    """Start the command, reap whatever ends, and return the command's exit code."""
    of_the_group: list[int] = []
    woken, wakes = os.pipe()
    os.set_blocking(woken, False)
    os.set_blocking(wakes, False)
    signal.set_wakeup_fd(wakes)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: of_the_group.append(received))
    signal.signal(signal.SIGCHLD, lambda *_: None)
    child = os.posix_spawn(command[0], list(command), environment)
    received, ends_by_s = b"", None
    while True:
        if (code := _reaped(child)) is not None:
            _say_what_is_left()
            return code
        left_s = None if ends_by_s is None else max(ends_by_s - time.monotonic(), 0.0)
        if left_s == 0.0:
            return 128 + received[0]
        ready, _, _ = select.select([lifeline, woken], [], [], left_s)
        if woken in ready:
            os.read(woken, 4096)
        if lifeline in ready:
            received = os.read(lifeline, 1)
            if not received:  # whoever waits for this session is gone
                return 128 + signal.SIGKILL
            if received[0] in of_the_group:  # the whole group was sent it, pytest, too
                of_the_group.remove(received[0])
            else:
                _send_to_the_group(received[0])
            if not (patient and received[0] == signal.SIGINT):
                ends_by_s = time.monotonic() + ENDS_WITHIN_S


def _send_to_the_group(number: int) -> None:
    """Send a signal to pytest, its workers and what stands in their group, as a terminal does."""
    for pid, _ in processes():
        with suppress(ProcessLookupError):
            if pid != os.getpid() and os.getpgid(pid) == os.getpgid(0):
                os.kill(pid, number)


def _reaped(child: int) -> int | None:
    """Reap what has ended; return the exit code of `child` once that has."""
    with suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            if ended[0] == child:
                return _exit_code(ended[1])
    return None


def _say_what_is_left() -> None:
    """Name the processes that tests left: they end now, and a test should have ended them."""
    for pid, words in processes():
        if pid != os.getpid():
            print(f"left by a test, ended now: {words[:150]}", file=sys.stderr, flush=True)


def processes() -> Iterator[tuple[int, str]]:
    """Yield number and command line of every process that this one can see."""
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            words = (path / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            if words:  # a zombie has none
                yield int(path.name), words


def _exit_code(status: int) -> int:
    code = os.waitstatus_to_exitcode(status)
    return code if code >= 0 else 128 - code


def _checked(result: int) -> None:
    if result != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
