"""The desk at which a detached run waits for the answer to a prompt."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event, Lock

from station.clock import Clock, boot_seconds
from station.console import span
from station.control.channel import Incoming
from station.errors import Aborted
from station.method.prompts import ABORT, Prompt, ended_at

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
