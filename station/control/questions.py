"""The questions of a run: who is asked, within what time, and what the log keeps of it.

An answers file, the simulated world, the terminal of the run, or whoever is attached to it answers;
what a prompt is, and what may be answered to it, stands in `station.method.prompts`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from threading import Event, Lock
from typing import Any, Protocol

from station.clock import Clock, RealClock, boot_seconds
from station.console import span, tell
from station.control.channel import Incoming
from station.control.signals import wishes_end_a_prompt
from station.errors import Aborted, InputError, UnansweredPrompt
from station.method.prompts import ABORT, DONE, Asking, Prompt, ended_at, meaning
from station.record.events import LEFT_FOR_THE_END
from station.speech import answered

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


class Log(Protocol):
    """Where questions and answers are kept: the record of a run."""

    def event(self, kind: str, *, durable: bool = True, **details: Any) -> object:
        """Add an event."""
        ...


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
        self._record: Log | None = None
        self._notify: Callable[[str], None] = lambda text: None
        self.left: list[Prompt] = []
        """What a person is asked once the results are written."""

    def listen_at(self, desk: PromptQueue) -> None:
        """Get the answers of a detached run from there."""
        self._desk = desk if self._detached else None

    def record_in(self, record: Log, notify: Callable[[str], None]) -> None:
        """Keep questions and answers in a log, and let `notify` tell who is not at the bench."""
        self._record, self._notify = record, notify

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
            f"\n  {prompt.id}: {self._answers[prompt.id]}    # write {prompt.answer_in_file}"
            for prompt in prompts
            if prompt.id in self._answers and not self._meant(prompt)
        ]
        if unknown:
            raise InputError(
                "the answers file has entries that are no answer, nothing was energised; correct "
                f"them:{''.join(unknown)}"
            )
        if self._interactive:
            return
        missing = [
            prompt
            for prompt in prompts
            if prompt.id not in self._answers and not self._acts_alone(prompt)
        ]
        if missing:
            listed = "".join(
                f"\n  {prompt.id}: {prompt.answer_in_file}    # {prompt.text}" for prompt in missing
            )
            raise UnansweredPrompt(
                "no operator can be asked, nothing was energised; give these entries in a YAML "
                f"file with --answers FILE:{listed}"
            )

    def ask(self, prompt: Prompt, of: str = "step") -> Answer:
        """Put a prompt of a step or a driver and return its answer; the log has both.

        Raises Aborted when the operator says abort.
        """
        if self._record is not None and self._asks_a_person(prompt):
            self._record.event("prompt-shown", durable=False, **prompt.to_data(), of=of)
            self._notify(prompt.text)
        answer = self._answer(prompt)
        if self._record is not None:
            about: dict[str, Any] = {"id": prompt.id, "text": prompt.text}
            self._record.event("prompt", **about, answer=answer.text, by=answer.by, of=of)
        return answer

    def ask_later(self, prompt: Prompt, of: str) -> bool:
        """Leave to the end of the run what nothing waits for; whether it was left.

        What an answers file or the simulated world answers is to be asked now.
        """
        if not self.would_wait(prompt):
            return False
        self.left.append(prompt)
        if self._record is not None:
            self._record.event(LEFT_FOR_THE_END, id=prompt.id, text=prompt.text, of=of)
        return True

    def _answer(self, prompt: Prompt) -> Answer:
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
        if not self._interactive:  # asked because of what was measured: no check knew of it
            raise UnansweredPrompt(
                f"the prompt {prompt.id} needs a person, and no operator can be asked; give "
                f"`{prompt.id}: {DONE}` in a YAML file with --answers FILE: {prompt.text}"
            )
        if self._desk is not None:
            return self._desk.ask(prompt)
        with self._clock.waiting_for_person(), wishes_end_a_prompt(self._clock, prompt.id):
            tell("\n" + "\n".join(prompt.lines))
            discard_typed()
            return typed(prompt)

    def would_wait(self, prompt: Prompt) -> bool:
        """Whether a person would have to be waited for: neither file nor world answers it."""
        return self._meant(prompt) in (None, ABORT) and not self._acts_alone(prompt)

    def _asks_a_person(self, prompt: Prompt) -> bool:
        """Whether a person is asked: the answers file does not end the run there either."""
        return self.would_wait(prompt) and self._meant(prompt) is None

    def ask_what_is_left(self) -> None:
        """Put what was left for the end of a run; raises nothing: nothing depends on it any more.

        What is not confirmed is named.
        """
        for prompt in self.left:
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

        There `done` stands for the value of an act too: whoever writes the file knows it.
        """
        given = self._answers.get(prompt.id)
        if given is None or not given.strip():
            return None
        if prompt.typed:
            return prompt.meaning(given)
        return prompt.meaning(given) or meaning(given)


def typed(prompt: Prompt, question: str = "") -> str:
    """Return the answer that a person types; anything else is asked again.

    Raises Aborted where that is to end the run.
    """
    asking = Asking(prompt)
    while True:
        tell(question or asking.question, end="")
        line = answered(sys.stdin.readline())
        known = asking.understands(line)
        answer = asking.take(line) if line else ABORT  # the terminal is gone
        if answer == ABORT:
            raise ended_at(prompt.id, line)
        if answer is not None:
            return answer
        if not known:
            tell(f"   {line.strip()!r} is no answer here")


LOOKS_EVERY_S = 0.1
"""Real time between two looks of a run that waits for a person."""
ANSWERED_WITHIN_S = 30 * 60.0
"""Real time after which a detached run that nobody answers makes its bench safe."""


def wait_for_person(clock: Clock, wakes: Event, over: Callable[[], bool]) -> None:
    """Wait until `over`; raises what ends the run instead.

    Time goes on meanwhile, so that interlocks are watched. Virtual time stands still: it would
    come to the end of all days.
    """
    speed: float | None = getattr(clock, "speed", None)
    with clock.waiting_for_person():
        while not over():
            if speed is None:
                wakes.wait(LOOKS_EVERY_S)
                clock.sleep(0.0)  # raises what ends the run
            else:
                clock.sleep(LOOKS_EVERY_S * speed)


class PromptQueue:
    """Where a run without a terminal asks, and where whoever is attached to it answers."""

    def __init__(self, clock: Clock, within_s: float = ANSWERED_WITHIN_S) -> None:
        self._clock = clock
        self._within_s = within_s
        self._lock = Lock()
        self._wakes = Event()
        self._asked: Prompt | None = None
        self._answer: str | None = None
        self._typed = ""

    def ask(self, prompt: Prompt) -> str:
        """Wait for the answer to a prompt: `done`, or the value that is asked for.

        Raises Aborted where the answer ends the run, or none comes in time, and what ends the run
        meanwhile.
        """
        until_s = boot_seconds() + self._within_s
        with self._lock:
            self._asked, self._answer = prompt, None
            self._wakes.clear()
        try:
            wait_for_person(
                self._clock,
                self._wakes,
                lambda: self._answer is not None or boot_seconds() > until_s,
            )
        finally:
            with self._lock:
                self._asked, answer = None, self._answer
        if answer is None:
            raise Aborted(
                f"no answer came to the prompt {prompt.id} of this detached run within "
                f"{span(self._within_s)}"
            )
        if answer == ABORT:
            raise ended_at(prompt.id, self._typed)
        return answer

    def take(self, incoming: Incoming) -> None:
        """Take an answer; one to a prompt that does not wait, or that is no answer, is refused."""
        prompt_id, text = str(incoming.details.get("id")), str(incoming.details.get("text", "?"))
        with self._lock:
            asked = self._asked
            if asked is None or prompt_id != asked.id or self._answer is not None:
                sentence = f"the prompt {prompt_id} no longer waits for an answer"
                incoming.answer(outcome="refused", said=sentence)
            elif (answer := asked.meaning(text)) is None:
                incoming.answer(outcome="no-answer", said=asked.hint)
            else:
                self._answer, self._typed = answer, text
                incoming.answer(outcome="taken", said=answer)
        self._wakes.set()
