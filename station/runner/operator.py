"""The operator: requests that a person, a file or the simulated world answers; what is shown."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from station.clock import Clock, boot_seconds
from station.console import Prompt, span, tell
from station.control.signals import wishes_end_a_prompt
from station.control.status import FinishedUnit, time_left_s
from station.errors import Aborted, InputError, UnansweredPrompt

DONE, ABORT = "done", "abort"
GO_ON = frozenset(("", DONE, "y", "yes"))
END = frozenset(("no", "n", "q", "quit", ABORT))
HINT = f"Enter or `{DONE}` to go on, `{ABORT}` to end the run"
HINT_AT_THE_END = f"Enter or `{DONE}` once it is, `{ABORT}` to leave it; nothing else waits"


def meaning(text: str) -> str | None:
    """Return `done`, `abort`, or None for what is neither: nobody guesses at a safety question."""
    word = text.strip().lower()
    if word in GO_ON:
        return DONE
    # In doubt towards the end: `abort!` is meant.
    return ABORT if word.rstrip("!.") in END else None


def discard_typed() -> None:
    """Forget the keys that were pressed before a prompt was shown; they answer something else."""
    if sys.platform == "win32":
        import msvcrt

        while msvcrt.kbhit():
            msvcrt.getwch()
        return
    import termios

    # No terminal: nothing was typed.
    with suppress(AttributeError, OSError, ValueError, termios.error):
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)


@dataclass(frozen=True)
class Answer:
    """What was answered and by whom: `operator`, `answers file`, `simulated world`."""

    text: str
    by: str


class Operator:
    """Whoever answers prompts in this run.

    `act` does a physical act in the simulated world and says what was done; None on a real bench.
    """

    def __init__(
        self,
        clock: Clock,
        answers: Mapping[str, str],
        *,
        interactive: bool,
        act: Callable[[str], str] | None,
    ) -> None:
        self._clock = clock
        self._answers = answers
        self._interactive = interactive
        self._act = act

    def check(self, prompts: Sequence[Prompt]) -> None:
        """Raise UnansweredPrompt, naming all of them, when a prompt would stay unanswered.

        Raises InputError where the answers file holds what is no answer.
        """
        unknown = [
            f"\n  {prompt.id}: {self._answers[prompt.id]}"
            for prompt in prompts
            if prompt.id in self._answers and not self._meant(prompt.id)
        ]
        if unknown:
            raise InputError(
                f"the answers file has entries that are no answer, nothing was energised; write "
                f"`{DONE}`, or `{ABORT}`:{''.join(unknown)}"
            )
        if self._interactive:
            return
        missing = [
            prompt
            for prompt in prompts
            if prompt.id not in self._answers and not (prompt.physical and self._act)
        ]
        if missing:
            listed = "".join(f"\n  {prompt.id}: {DONE}    # {prompt.text}" for prompt in missing)
            raise UnansweredPrompt(
                "nobody can be asked here, nothing was energised; give these entries in a YAML "
                f"file with --answers FILE:{listed}"
            )

    def ask(self, prompt: Prompt) -> Answer:
        """Put a prompt and return its answer; raises Aborted when the operator says abort."""
        given = self._meant(prompt.id)
        if given == ABORT:
            raise Aborted(f"the answers file ended the run at the prompt {prompt.id}")
        if prompt.physical and self._act is not None:  # a file saying `done` mounts nothing there
            return Answer(self._act(prompt.id), "simulated world")
        if given is not None:
            return Answer(DONE, "answers file")
        if not self._interactive:
            self.check([prompt])
        with self._clock.waiting_for_person(), wishes_end_a_prompt(self._clock):
            tell(f"\n>> {prompt.text}")
            discard_typed()
            answer = self._typed(f"   [{prompt.id}] {HINT}: ")
        if answer == ABORT:
            raise Aborted(f"the operator ended the run at the prompt {prompt.id}")
        return Answer(DONE, "operator")

    def would_wait(self, prompt: Prompt) -> bool:
        """Whether a person would have to be waited for: neither file nor world says `done`."""
        return self._meant(prompt.id) != DONE and not (prompt.physical and self._act is not None)

    def would_ask(self, prompt: Prompt) -> bool:
        """Whether a person is asked: the answers file does not end the run there either."""
        return self.would_wait(prompt) and self._meant(prompt.id) is None

    def ask_at_the_end(self, prompts: Sequence[Prompt]) -> None:
        """Put what was left for the end of a run; raises nothing: nothing depends on it any more.

        What is not confirmed is named.
        """
        for prompt in prompts:
            tell(f"\n>> {prompt.text}")
            answer = ABORT
            if self._interactive and self._meant(prompt.id) is None:
                with suppress(Aborted), wishes_end_a_prompt(self._clock):
                    discard_typed()
                    answer = self._typed(f"   [{prompt.id}] {HINT_AT_THE_END}: ")
            if answer != DONE:
                tell(f"   not confirmed: {prompt.id}; nothing of the run depends on it")

    def _meant(self, prompt_id: str) -> str | None:
        """Return what the answers file means for a prompt; None where it holds no answer to it."""
        given = self._answers.get(prompt_id)
        return meaning(given) if given is not None and given.strip() else None

    def _typed(self, question: str) -> str:
        """Return `done` or `abort` as a person types it; anything else is asked again."""
        while True:
            tell(question, end="")
            line = sys.stdin.readline()
            answer = meaning(line) if line else ABORT  # the terminal is gone
            if answer is not None:
                return answer
            tell(f"   {line.strip()!r} is no answer here")


LONGER = "not known, it takes longer than expected"
LONGER_ON_A_BAR = "not known"
BAR_WIDTH = 16
LEFT_WIDTH = len("100 %  bench time left 26 h 15 min")
"""On a narrow terminal what the step does is shortened, never the time left."""
REPEAT_S = 2.0
"""Real time between two lines of progress where the output is no terminal."""


def how_long(expected_s: float, clock: Clock) -> str:
    """Return how long a run is expected to take, in bench time and as the operator waits."""
    speed: float | None = getattr(clock, "speed", None)
    if speed is None:
        return f"bench time about {span(expected_s)} (virtual: waiting is skipped)"
    if speed == 1.0:
        return f"about {span(expected_s)}"
    waited = span(expected_s / speed)
    return f"bench time about {span(expected_s)}, {speed:g} times as fast: about {waited}"


class Progress:
    """Write progress to standard error; a live bar on a terminal, a line now and then elsewhere."""

    def __init__(
        self, total_s: float, *, units: Mapping[str, float] | None = None, quiet: bool = False
    ) -> None:
        self._later_s = total_s
        """What the steps after the present one should take."""
        self._step_s = 0.0
        self._before_s = 0.0
        """What the steps before it took."""
        self._elapsed_s = 0.0
        self._units = dict(units or {})
        """The units of work that are still to be done, and how long they should take."""
        self._finished: list[FinishedUnit] = []
        self._number = self._title = ""
        self._quiet = quiet
        self._said_at = 0.0
        self._bar = None
        self._task = None
        if sys.stderr.isatty() and not quiet:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn
            from rich.table import Column

            self._bar = Progress(
                BarColumn(bar_width=BAR_WIDTH),
                TextColumn(
                    "{task.percentage:>3.0f} %  bench time left {task.fields[left]}",
                    table_column=Column(no_wrap=True, min_width=LEFT_WIDTH),
                ),
                TextColumn(
                    "{task.description}", table_column=Column(no_wrap=True, overflow="ellipsis")
                ),
                console=Console(stderr=True),
                transient=True,
            )
            self._task = self._bar.add_task("", total=max(total_s, 1e-9), left=span(total_s))

    def __enter__(self) -> Progress:
        if self._bar is not None:
            with suppress(OSError):  # a terminal that is gone ends no run
                self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            with suppress(OSError):
                self._bar.stop()

    def step(self, number: str, title: str, expected_s: float) -> None:
        """Say that a step begins that is expected to take `expected_s` of bench time."""
        self._before_s += self._elapsed_s
        self._elapsed_s = 0.0
        self._step_s = expected_s
        self._later_s -= expected_s
        self._number, self._title = number, f"{number}  {title}"
        self.say(self._title)
        self.at(0.0)

    def unit_finished(self, unit: str) -> None:
        """Take note that a unit of work is finished: the pace of the run shows in them."""
        if unit in self._units:
            at_s = self._before_s + self._elapsed_s
            self._finished.append(FinishedUnit(at_s, self._units.pop(unit)))

    def at(self, elapsed_s: float, detail: str = "") -> None:
        """Say how the run stands after `elapsed_s` of work on its step."""
        self._elapsed_s = elapsed_s
        if self._quiet:
            return
        done_s = self._before_s + elapsed_s
        forecast_s = max(self._later_s, 0.0) + max(self._step_s - elapsed_s, 0.0)
        left_s = time_left_s(forecast_s, self._finished, sum(self._units.values()), done_s)
        total_s = max(done_s + left_s, 1e-9)
        left = span(left_s) if left_s > 0.0 else LONGER
        if self._bar is not None and self._task is not None:
            room = self._bar.console.width - BAR_WIDTH - LEFT_WIDTH - 2  # a blank between columns
            text = doing(self._number, self._title, detail, room)
            left = left if left_s > 0.0 else LONGER_ON_A_BAR
            with suppress(OSError):
                self._bar.update(
                    self._task, completed=done_s, total=total_s, description=text, left=left
                )
        elif boot_seconds() - self._said_at >= REPEAT_S:
            percent = 100 * done_s / total_s
            self.say(f"    {percent:3.0f} %  bench time left {left}  {detail}".rstrip())

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Leave the terminal to somebody else for a while."""
        if self._bar is not None:
            self._bar.stop()
        yield
        if self._bar is not None:
            self._bar.start()

    def say(self, text: str) -> None:
        """Write a line that stays."""
        if self._quiet:
            return
        self._said_at = boot_seconds()
        if self._bar is None:
            tell(text)
            return
        with suppress(OSError):  # a terminal that is gone ends no run
            self._bar.console.print(text, highlight=False)


def doing(number: str, title: str, detail: str, room: int) -> str:
    """Return what a step does in a line of `room` characters, in whole words.

    The title, which stands in a line of its own above, gives way to what goes on just now.
    """
    text = f"{title}  {detail}".rstrip()
    if len(text) > room and detail:
        text = f"{number}  {detail}"
    if len(text) <= room:
        return text
    kept = text[: max(room - 1, 0)]
    if not text[len(kept)].isspace():
        kept = kept.rpartition(" ")[0].rstrip() or kept
    return kept.rstrip(" ,;:") + "…"
