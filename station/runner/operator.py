"""The operator: requests that a person, a file or the simulated world answers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

from station.clock import Clock, RealClock
from station.console import tell
from station.control.answers import PromptQueue
from station.control.signals import wishes_end_a_prompt
from station.errors import Aborted, InputError, UnansweredPrompt
from station.method.prompts import ABORT, DONE, Asking, Prompt, ended_at, meaning

HINT_AT_THE_END = f"Enter or `{DONE}` once it is, `{ABORT}` to leave it; nothing else waits"
READS_WITHIN_S = 0.5
"""Real time after a prompt is shown within which nobody has read it, as of a key struck twice."""


def discard_typed() -> None:
    """Forget the keys that were pressed before a person can have read the prompt that is shown."""
    if not sys.stdin.isatty():
        return
    RealClock().sleep(READS_WITHIN_S)
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
    `rehearse` asks a person for it first, as a real bench would. One that is `detached` has no
    terminal: whoever is attached to its run answers.
    """

    def __init__(
        self,
        clock: Clock,
        answers: Mapping[str, str],
        *,
        interactive: bool,
        act: Callable[[str], str] | None,
        rehearse: bool = False,
        detached: bool = False,
    ) -> None:
        self._clock = clock
        self._answers = answers
        self._interactive = interactive
        self._act = act
        self._rehearse = rehearse
        self._detached = detached
        self._desk: PromptQueue | None = None
        """Where a detached run gets its answers, None where this process has a terminal."""

    def listen_at(self, desk: PromptQueue) -> None:
        """Get the answers of a detached run from there."""
        self._desk = desk if self._detached else None

    @property
    def needs_no_terminal(self) -> bool:
        """Whether every prompt is answered without the terminal of this process."""
        return self._detached or not self._interactive

    def _acts_alone(self, prompt: Prompt) -> bool:
        """Whether the simulated world does what a prompt asks for, and nobody is asked."""
        return prompt.physical and self._act is not None and not self._rehearse

    def check(self, prompts: Sequence[Prompt]) -> None:
        """Raise UnansweredPrompt, naming all of them, when a prompt would stay unanswered.

        Raises InputError where the answers file holds what is no answer.
        """
        unknown = [
            f"\n  {prompt.id}: {self._answers[prompt.id]}"
            for prompt in prompts
            if prompt.id in self._answers and not self._meant(prompt)
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
            if prompt.id not in self._answers and not self._acts_alone(prompt)
        ]
        if missing:
            listed = "".join(f"\n  {prompt.id}: {DONE}    # {prompt.text}" for prompt in missing)
            raise UnansweredPrompt(
                "no operator can be asked, nothing was energised; give these entries in a YAML "
                f"file with --answers FILE:{listed}"
            )

    def ask(self, prompt: Prompt) -> Answer:
        """Put a prompt and return its answer; raises Aborted when the operator says abort."""
        given = self._meant(prompt)
        if given == ABORT:
            raise Aborted(f"the answers file ended the run at the prompt {prompt.id}")
        if self._act is not None and self._acts_alone(prompt):  # a file's `done` mounts nothing
            return Answer(self._act(prompt.id), "simulated world")
        answer = self._ask_a_person(prompt) if given is None else given
        if self._act is not None and prompt.physical:
            self._act(prompt.id)
        return Answer(answer, "operator" if given is None else "answers file")

    def _ask_a_person(self, prompt: Prompt) -> str:
        if not self._interactive:
            self.check([prompt])
        if self._desk is not None:
            return self._desk.ask(prompt)
        with self._clock.waiting_for_person(), wishes_end_a_prompt(self._clock, prompt.id):
            tell("\n" + "\n".join(prompt.lines))
            discard_typed()
            return typed(prompt)

    def would_wait(self, prompt: Prompt) -> bool:
        """Whether a person would have to be waited for: neither file nor world answers it."""
        return self._meant(prompt) in (None, ABORT) and not self._acts_alone(prompt)

    def would_ask(self, prompt: Prompt) -> bool:
        """Whether a person is asked: the answers file does not end the run there either."""
        return self.would_wait(prompt) and self._meant(prompt) is None

    def ask_at_the_end(self, prompts: Sequence[Prompt]) -> None:
        """Put what was left for the end of a run; raises nothing: nothing depends on it any more.

        What is not confirmed is named.
        """
        for prompt in prompts:
            tell(f"\n>> {prompt.text}")
            answer = ABORT
            if self._interactive and not self._detached and self._meant(prompt) is None:
                with suppress(Aborted), wishes_end_a_prompt(self._clock, prompt.id):
                    discard_typed()
                    answer = typed(prompt, f"   [{prompt.id}] {HINT_AT_THE_END}: ")
            if answer != DONE:
                tell(f"   not confirmed: {prompt.id}; nothing of the run depends on it")

    def _meant(self, prompt: Prompt) -> str | None:
        """Return what the answers file means for a prompt; None where it holds no answer to it.

        There `done` stands for a value too: whoever writes the file knows it.
        """
        given = self._answers.get(prompt.id)
        if given is None or not given.strip():
            return None
        return prompt.meaning(given) or meaning(given)


def typed(prompt: Prompt, question: str = "") -> str:
    """Return the answer that a person types; anything else is asked again.

    Raises Aborted where that is to end the run.
    """
    asking = Asking(prompt)
    while True:
        tell(question or asking.question, end="")
        line = sys.stdin.readline()
        known = asking.understands(line)
        answer = asking.take(line) if line else ABORT  # the terminal is gone
        if answer == ABORT:
            raise ended_at(prompt.id, line)
        if answer is not None:
            return answer
        if not known:
            tell(f"   {line.strip()!r} is no answer here")
