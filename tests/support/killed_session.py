"""Start a session of tests, end it in a way, and print what is left of it ten seconds later.

python killed_session.py HOW AFTER_S PYTEST_ARGUMENT… ends it so long after it began, or once a
process hangs in the kernel where AFTER_S is `stuck`. HOW is a signal and whom it is sent to:
`SIGKILL main`, `SIGTERM group`, `SIGKILL pytest` (the process that the tests run in), `SIGKILL
worker`; or `none`. With `shared` before it the session may have no namespaces. It looks from
namespaces of its own, in which there is nothing else.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

from leftovers import SESSION
from own_namespaces import INSIDE, folders_to_hide, processes, run_inside
from places import ROOT

LOOKS_AFTER_S = 10.0
GIVES_UP_AFTER_S = 120.0
LOOKING, SHARED = "looking", "shared"
PYTEST = [sys.executable, "-P", "-m", "pytest", "-p", "no:cacheprovider"]
MAY_NOT = ["setpriv", "--bounding-set", "-sys_admin", "--inh-caps", "-sys_admin"]
WORKER = "import sys;exec(eval(sys.stdin.readline()))"
"""The command by which pytest-xdist starts a worker."""


def main(how: str, after: str, *arguments: str) -> int:
    environment = {key: text for key, text in os.environ.items() if key not in (INSIDE, SESSION)}
    before = seen()
    process = subprocess.Popen(
        [*MAY_NOT * (how.split()[0] == SHARED), *PYTEST, *arguments],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        text=True,
        encoding="utf-8",
    )
    began_s = time.monotonic()
    while not is_time(after, time.monotonic() - began_s) and process.poll() is None:
        time.sleep(0.01)
    most, hung = len(list(processes())), stuck()
    ended = process.poll() is not None
    *_, number, whom = ["", *how.removeprefix(SHARED).split()]
    if how != "none":
        strike(process.pid, number, whom)
    with suppress(subprocess.TimeoutExpired):
        process.wait(LOOKS_AFTER_S if how != "none" else GIVES_UP_AFTER_S)
    if process.poll() is None or "SIGKILL" in how:
        time.sleep(LOOKS_AFTER_S)
    code, left = process.poll(), {key: sorted(seen()[key] - before[key]) for key in before}
    process.kill()
    words = process.stdout.read() if process.stdout is not None and not left["processes"] else ""
    about = {"most": most, "hung": hung, "ended_before": ended, "code": code, "words": words}
    print(json.dumps({**about, "left": left}))
    return 0


def is_time(after: str, passed_s: float) -> bool:
    """Whether the session is to be ended now."""
    if passed_s > GIVES_UP_AFTER_S:
        return True
    if after != "stuck":
        return passed_s > float(after)
    hung = set(stuck())
    time.sleep(0.5)  # what waits for a real disk is back by then
    return bool(hung & set(stuck()))


def strike(process: int, number: str, whom: str) -> None:
    """Send a signal to the session's process, its group, or one that it has started."""
    sent = signal.Signals[number]
    match whom:
        case "main":
            os.kill(process, sent)
        case "group":
            os.killpg(process, sent)
        case "worker":
            os.kill(next(pid for pid, words in processes() if WORKER in words), sent)
        case "pytest":
            os.kill(next(pid for pid, words in processes() if "run_module" in words), sent)


def seen() -> dict[str, set[str]]:
    """Return the processes that there are, the mounts, and what lies in the shared folders."""
    shared = folders_to_hide([])
    return {
        "processes": {f"{pid} {words[:200]}" for pid, words in processes()},
        "stuck": set(stuck()),
        "mounts": set(Path("/proc/self/mounts").read_text(encoding="utf-8").splitlines()),
        "files": {str(path) for place in shared for path in place.rglob("*")},
    }


def stuck() -> list[str]:
    """Return the processes that hang in the kernel, where no signal ends them."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            text = path.read_text(encoding="utf-8", errors="replace")
            if text.rpartition(")")[2].split()[0] == "D":
                found.append(text.partition(")")[0])
    return found


if __name__ == "__main__":
    if sys.argv[1] == LOOKING:
        sys.exit(main(*sys.argv[2:]))
    kept = [ROOT, *(Path(path) for path in sys.path if Path(path).is_dir())]
    kept += [Path(sys.prefix), Path(sys.base_prefix)]
    sys.exit(run_inside([sys.executable, __file__, LOOKING, *sys.argv[1:]], kept, patient=False))
