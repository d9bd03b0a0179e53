"""`station run --detach` and `station attach`: a run that outlives every terminal."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from shlex import quote
from threading import Event, Thread
from types import FrameType
from typing import IO, Any, NoReturn

from station.cli.analysing import name_unused, print_document
from station.cli.controlling import abort_run
from station.cli.groups import LANG
from station.cli.running import ANNOUNCE, may_ask
from station.clock import RealClock, boot_seconds, local_time, utc_now
from station.console import span, tell
from station.control.channel import NotRunning, ask, not_running
from station.control.questions import Operator, discard_typed
from station.control.signals import WISHES
from station.control.status import read_state, read_status
from station.errors import EXIT_ABORTED, EXIT_DONE, EXIT_FAULT, EXIT_INTERLOCK, InputError
from station.files.locks import is_held
from station.method.prompts import ABORT, Asking, Prompt
from station.record.careful_reading import read_json
from station.record.events import RESUMED, RUN_STARTED, LogTail, in_words, whole_bench
from station.record.events import Event as LogEvent
from station.record.folder import REPORT, RESULTS, RunFolder
from station.record.layout import EVENTS, LOCK, RUN
from station.record.run_state import RunState
from station.runner.evaluation import evaluate_run, exit_code_of
from station.runner.progress import Progress, time_of_day
from station.speech import ENGLISH, answered, show

LOOKS_EVERY_S = 0.2
"""Real time between two looks at the log."""
AGAIN_WITHIN_S = 2.0
"""The log has a prompt a moment before the run takes answers to it."""
ABORT_WITHIN_S = 120.0
DETACH = "d"
LATEST = 20
"""Lines that say why a run did not begin."""


def run_detached(arguments: Sequence[str], *, as_json: bool = False) -> int:
    """Begin a run in a process of its own that no terminal ends, and return once it has a folder.

    `arguments` are those of the command line, without `--detach`. What keeps the run from
    beginning is shown here, with its exit code.
    """
    process, folder = begin(arguments, lambda line: tell(line, end=""))
    if folder is None:
        return EXIT_FAULT if process.returncode is None else process.returncode
    if as_json:
        print(json.dumps({"run": str(folder), "process": process.pid, "exit_code": EXIT_DONE}))
        return EXIT_DONE
    show(f"the run goes on in process {process.pid}, without this terminal")
    show(f"to watch it and answer its prompts: station attach {quote(str(folder))}")
    return EXIT_DONE


def run_elsewhere(
    arguments: Sequence[str], *, detach: bool, non_interactive: bool, as_json: bool
) -> int | None:
    """Begin a run in a process of its own; return the exit code, None where it gets none.

    It gets one where it is to be detached, and where a person watches it at this terminal.
    """
    if detach:
        wanted = [argument for argument in arguments if argument != "--detach"]
        return run_detached(wanted, as_json=as_json)
    person = sys.stderr.isatty() and may_ask(non_interactive=non_interactive) and not as_json
    return run_attended(arguments) if person and sys.platform != "win32" else None


def run_attended(arguments: Sequence[str]) -> int:
    """Begin a run in a process of its own and show it here; return the exit code of the run.

    A terminal that closes, and `d`, leave the run to itself; Ctrl-C and SIGTERM end it.
    """
    process, folder = begin(arguments, lambda line: tell(line, end=""))
    if folder is None:
        return EXIT_FAULT if process.returncode is None else process.returncode
    tell(f"another terminal sees it with: station attach {quote(str(folder))}")
    signal.signal(signal.SIGTERM, end_as_ctrl_c)
    return attach(folder)


def end_as_ctrl_c(number: int, frame: FrameType | None) -> NoReturn:
    """Do what Ctrl-C does, and say which signal it was."""
    raise KeyboardInterrupt(signal.Signals(number).name)


def begin_detached(arguments: Sequence[str]) -> Path:
    """Begin a run in a process of its own and return its folder; InputError with what is wrong."""
    lines: list[str] = []
    _, folder = begin(arguments, lines.append)
    if folder is None:
        raise InputError("".join(lines[-LATEST:]).strip() or "the run did not begin")
    return folder


def begin(
    arguments: Sequence[str], show: Callable[[str], None]
) -> tuple[subprocess.Popen[bytes], Path | None]:
    """Begin a run in a process of its own; return it, and its folder once there is one.

    `show` gets each line that the run prints until then.
    """
    with tempfile.TemporaryDirectory(prefix="station-") as place:
        announced = Path(place) / "folder"
        process = subprocess.Popen(
            [sys.executable, "-m", "station", *in_english(arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env={**os.environ, ANNOUNCE: str(announced)},
            start_new_session=True,
        )
        assert process.stderr is not None
        began = Event()
        relay = Thread(target=relayed, args=(process.stderr, began, show), daemon=True)
        relay.start()
        while not announced.exists() and process.poll() is None:
            RealClock().sleep(LOOKS_EVERY_S / 10)
        if not announced.exists():
            relay.join(1.0)
            return process, None
        began.set()
        return process, Path(announced.read_text(encoding="utf-8"))


def in_english(arguments: Sequence[str]) -> list[str]:
    """Return a command line whose process says everything in English: who shows it translates."""
    kept, rest = [], iter(arguments)
    for argument in rest:
        if argument == LANG:
            next(rest, None)
        elif not argument.startswith(f"{LANG}="):
            kept.append(argument)
    return [LANG, ENGLISH, *kept]


def relayed(messages: IO[bytes], began: Event, show: Callable[[str], None]) -> None:
    """Take what a run prints; show it until the run has its folder, where the rest is recorded."""
    for line in messages:
        if not began.is_set():
            show(line.decode(errors="replace"))


def attach(folder: Path) -> int:
    """Show a running run, and answer its prompts; return the exit code of the run.

    Ctrl-C ends the run with a safe bench; `d` and Enter leaves it to itself.
    """
    if not (folder / EVENTS).is_file():
        raise InputError(f"{folder} is no run folder: it holds no {EVENTS}")
    if not is_held(folder / LOCK):
        return how_it_ended(folder, "")
    if sys.stdin.isatty():
        tell(f"Ctrl-C ends this run with a safe bench; `{DETACH}` and Enter leaves it running")
    viewer = Viewer(folder)
    try:
        left = viewer.watch()
    except EOFError:  # this terminal is gone, not the run
        left = is_held(folder / LOCK)
    except KeyboardInterrupt as wish:
        return end(folder, WISHES[str(wish) or "SIGINT"])
    if left:
        tell(f"the run goes on; to attach again: station attach {quote(str(folder))}")
        return EXIT_DONE
    return how_it_ended(folder, viewer.failure)


def end(folder: Path, by: str) -> int:
    """End a run by what a person did here.

    Each further Ctrl-C only cuts short the waits of making its bench safe.
    """
    tell("\nthe run is being ended; its bench is made safe")
    again = False
    while True:
        try:
            if again and not is_held(folder / LOCK):
                return how_it_ended(folder, "")
            abort_run(folder, ABORT_WITHIN_S, as_json=False, by=by)
            break
        except KeyboardInterrupt:
            again = True
            tell("\nthe bench is being made safe; that is never skipped, its waits are cut short")
        except InputError:  # it ended between two wishes
            if not again:
                raise
            return how_it_ended(folder, "")
    tell(f"to go on where it stopped: station resume {quote(str(folder))}")
    return EXIT_ABORTED


def how_it_ended(folder: Path, failure: str) -> int:
    """Say how a run that is over has ended, and return its exit code."""
    status, ended = read_status(folder), read_state(folder)
    if status.bench_safe:
        tell(whole_bench(ended.left_out(), ended.age()))
    if status.state == "finished" and (folder / RESULTS).is_file():
        if not status.bench_safe:
            tell("NOT VERIFIED: go to the bench and look at it now")
        run = RunFolder(folder)
        document, _ = evaluate_run(run)
        name_unused(run)
        print_document(document)
        show(f"report: {folder / REPORT}")
        ask_what_was_left(folder)
        return exit_code_of(document)
    failed = ended.process.failed
    failure = failure or (str(failed["message"]) if failed else "")
    again = f"`station resume {quote(str(folder))}` resumes it"
    tell(f"the run did not finish: {failure}; {again}" if failure else not_running(folder))
    if not status.bench_safe:
        tell(f"NOT VERIFIED: go to the bench and look at it now; last heard: {status.message}")
        return EXIT_FAULT
    code = int(failed["exit_code"]) if failed else EXIT_FAULT
    if code == EXIT_INTERLOCK:
        tell("first `station acknowledge` the bench")
    return code


def ask_what_was_left(folder: Path) -> None:
    """Ask for what no step waited for, in the run's last process."""
    left = read_state(folder).process.left_for_the_end
    operator = Operator(RealClock(), {}, interactive=sys.stdin.isatty(), act=None)
    operator.left += map(Prompt.from_data, left)
    operator.ask_what_is_left()


class LogTimes:
    """The time of day of each event of a run's log, which has the bench's time alone.

    `run.json` says when each process of the run began. On virtual time it is the bench time since
    the run began: nothing says when in the day that was.
    """

    def __init__(self, folder: Path) -> None:
        facts = read_json(folder / RUN)
        processes = [process["resumed_utc"] for process in facts.get("resumed", ())]
        self._begins = iter([facts.get("started_utc"), *processes])
        self._speed = self._first_s = 0.0
        self._began: tuple[float, datetime] | None = None

    def of(self, event: LogEvent) -> str:
        """Return when an event happened; each event of the log is asked for once, in order."""
        if event.kind == RUN_STARTED:
            self._speed, self._first_s = float(event.details.get("speed") or 0.0), event.time_s
        if event.kind in (RUN_STARTED, RESUMED):
            began = next(self._begins, None)
            self._began = (event.time_s, datetime.fromisoformat(began)) if began else None
        if self._began is None or not self._speed:
            return f"+ {span(event.time_s - self._first_s)}"
        began_s, utc = self._began
        moment = (utc + timedelta(seconds=(event.time_s - began_s) / self._speed)).astimezone()
        day = "" if moment.date() == local_time().date() else f"{moment:%Y-%m-%d} "
        return day + time_of_day(moment)


class Viewer:
    """One terminal on a run: what its log says as progress, and the prompts that wait."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._log = LogTail(folder)
        self._run = RunState()
        self._looked_s = boot_seconds()
        self._leaves = False
        self._taken: set[int] = set()

    @property
    def failure(self) -> str:
        """What ended the run's last process before its end, empty where nothing did."""
        failed = self._run.process.failed
        return str(failed.get("message", "")) if failed else ""

    @property
    def _open(self) -> dict[str, dict[str, Any]]:
        """The prompts that wait for an answer, by id, less those whose answer was taken here."""
        prompts = self._run.process.open_prompts.items()
        return {key: prompt for key, prompt in prompts if prompt["number"] not in self._taken}

    def watch(self) -> bool:
        """Show the run until it ends; whether the operator left before."""
        caught_up = list(self._log.new_events())
        planned = RunState(caught_up[:1]).planned
        times = LogTimes(self._folder)
        total_s = sum(float(step["expected_s"]) for step in planned.get("steps", ()))
        units = planned.get("units_expected", {})
        with Progress(total_s, units=units, folder=self._folder) as progress:
            for event in caught_up:
                self._note(event)
                self._show(event, progress, times.of(event))
            # The last of them may be long past.
            written_s = (self._folder / EVENTS).stat().st_mtime
            self._looked_s -= max(utc_now().timestamp() - written_s, 0.0)
            while True:
                alive = is_held(self._folder / LOCK)
                for event in self._log.new_events():
                    self._note(event)
                    self._show(event, progress)
                if not alive:
                    return False
                if self._open and sys.stdin.isatty():
                    with progress.paused():
                        self._answer()
                    if self._leaves:
                        return True
                elif self._wants_to_leave():
                    return True
                now_s = self._run.last_s + (boot_seconds() - self._looked_s) * self._run.speed
                progress.at(self._elapsed_s(now_s))

    def _note(self, event: LogEvent) -> None:
        """Keep what an event says of the run and its prompts."""
        self._run.add(event)
        self._looked_s = boot_seconds()

    def _expected_s(self) -> dict[str, float]:
        steps = self._run.planned.get("steps", ())
        return {step["step"]: float(step["expected_s"]) for step in steps}

    def _elapsed_s(self, now_s: float) -> float:
        """Return the time of work on the present step, in s."""
        process = self._run.process
        began_s = process.step_began_s.get(process.step or "", now_s)
        return now_s - began_s - process.paused_s(began_s, now_s)

    def _show(self, event: LogEvent, progress: Progress, when: str = "") -> None:
        """Show an event as the run's own terminal would; `when` it happened, if not just now."""
        details = event.details
        match event.kind:
            case "step-started":
                number = details["step"]
                progress.step(number, details["title"], self._expected_s().get(number, 0.0), when)
            case "step-finished":
                progress.at(self._elapsed_s(event.time_s), when=when)
            case "unit-finished":
                progress.unit_finished(details["unit"])
                progress.at(self._elapsed_s(event.time_s), details["unit"], when)
            case "prompt-shown" if not sys.stdin.isatty():
                progress.say(in_words(event), when)
            case "failed" | "paused" | "went-on" | "safe-state" | "pause-refused":
                progress.say(in_words(event), when)

    def _answer(self) -> None:
        """Put the oldest prompt that waits, until somebody has answered it, here or elsewhere."""
        prompt_id, details = next(iter(self._open.items()))
        prompt = Prompt.from_data(details)
        asking = Asking(prompt)
        tell("\n" + "\n".join(prompt.lines))
        discard_typed()
        tell(asking.question, end="")
        while prompt_id in self._open and is_held(self._folder / LOCK):
            line = typed_line(LOOKS_EVERY_S)
            for event in self._log.new_events():
                self._note(event)
            if prompt_id not in self._open:
                tell("   the run has ended" if self.failure else "   answered by somebody else")
                return
            if line is None:
                continue
            line = answered(line)
            if line.strip().lower() == DETACH:
                self._leaves = True
                return
            known, answer = asking.understands(line), asking.take(line)
            text = line.strip() if answer == ABORT else answer  # its own words are logged
            if text is not None and self._sent(prompt_id, text):
                self._taken.add(details["number"])
                return
            tell(asking.question if known else f"   {line!r} is no answer here: ", end="")

    def _sent(self, prompt_id: str, line: str) -> bool:
        """Send an answer; whether it was taken."""
        until_s = boot_seconds() + AGAIN_WITHIN_S
        while True:
            try:
                word = ask(self._folder, "answer", details={"id": prompt_id, "text": line})
            except NotRunning:
                return True
            if word.get("outcome") != "refused" or boot_seconds() > until_s:
                break
            RealClock().sleep(LOOKS_EVERY_S)
        if word.get("outcome") == "taken":
            return True
        tell(f"   {line!r}: {word.get('said')}: ", end="")
        return False

    def _wants_to_leave(self) -> bool:
        """Wait a moment; whether the operator asked to leave meanwhile."""
        if not sys.stdin.isatty():
            RealClock().sleep(LOOKS_EVERY_S)
            return False
        line = typed_line(LOOKS_EVERY_S)
        return line is not None and line.strip().lower() == DETACH


def typed_line(within_s: float) -> str | None:
    """Return the line that a person types within that time, None where there is none.

    Raises EOFError where the terminal is gone.
    """
    if not select.select([sys.stdin], [], [], within_s)[0]:
        return None
    try:
        line = sys.stdin.readline()
    except OSError:
        raise EOFError from None
    if not line:
        raise EOFError
    return line.rstrip("\n")
