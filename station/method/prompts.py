"""What a person is asked: a sentence, and where it helps a checklist, a picture and a value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

from station.errors import Aborted
from station.units import UnitError, format_quantity, parse_as

DONE, ABORT = "done", "abort"
GO_ON = frozenset(("", DONE, "y", "yes"))
END = frozenset(("no", "n", "q", "quit", ABORT))


def meaning(text: str) -> str | None:
    """Return `done`, `abort`, or None for what is neither: nobody guesses at a safety question."""
    word = text.strip().lower()
    if word in GO_ON:
        return DONE
    # In doubt towards the end: `abort!` is meant.
    return ABORT if word.rstrip("!.") in END else None


def ended_at(prompt_id: str, answer: str) -> Aborted:
    """Return the error of a run that an answer ended, as it was typed; empty: the input ended."""
    what = f"the answer `{answer.strip()}`" if answer else "the end of the input"
    return Aborted(f"{what} ended the run at the prompt {prompt_id}")


@dataclass(frozen=True)
class AskedValue:
    """A number that a person types, with its unit, between two bounds."""

    name: str
    unit: str
    low: float
    high: float

    @property
    def wanted(self) -> str:
        """Return what is asked for: `cell temperature, 20 degC to 200 degC`."""
        return f"{self.name}, {self.low:g} {self.unit} to {self.high:g} {self.unit}"

    def read(self, text: str) -> str | None:
        """Return a typed value with its unit; None for what is none, or is out of range."""
        try:
            value = float(text)
        except ValueError:
            try:
                value = parse_as(text, self.unit)
            except UnitError:
                return None
        return format_quantity(value, self.unit) if self.low <= value <= self.high else None


@dataclass(frozen=True)
class Prompt:
    """A request to the operator: a stable id, the sentence, and whether it is a physical act.

    A simulated bench does physical acts itself. Each line of `checklist` is confirmed on its own;
    `picture` is a file in the folder `pictures` of the procedure's package; `then` says what the
    run does next.
    """

    id: str
    text: str
    physical: bool = True
    checklist: tuple[str, ...] = ()
    picture: str = ""
    value: AskedValue | None = None
    then: str = ""

    @property
    def hint(self) -> str:
        """Return what may be answered once the checklist is done."""
        ends = f"`{ABORT}` to end the run"
        if self.value is not None:
            return f"type the {self.value.wanted}, or {ends}"
        return f"Enter or `{DONE}` to go on, {ends}"

    @property
    def typed(self) -> bool:
        """Whether it asks for a value and nothing else: no `done` stands for that."""
        return self.value is not None and not self.physical

    @property
    def answer_in_file(self) -> str:
        """Return what an answers file says: `done`, or in brackets which value is wanted."""
        return f"<{self.value.wanted}>" if self.value is not None and self.typed else DONE

    @property
    def lines(self) -> list[str]:
        """Return what a terminal shows before it asks."""
        shown = [f">> {self.text}"]
        if self.picture:
            shown.append(f"   picture: {self.picture} (the panel and the procedure's page show it)")
        if self.then:
            shown.append(f"   next: {self.then}")
        return shown

    def meaning(self, text: str) -> str | None:
        """Return the answer that a text is: `done`, `abort` or the value; None where it is none."""
        word = meaning(text)
        if self.value is None or word == ABORT:
            return word
        return self.value.read(text.strip())

    def to_data(self) -> dict[str, Any]:
        """Return it as the log keeps it: what it does not have is left out."""
        return {key: value for key, value in asdict(self).items() if value and key != "physical"}

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Self:
        """Return a prompt of the log."""
        value = data.get("value")
        return cls(
            str(data["id"]),
            str(data["text"]),
            checklist=tuple(map(str, data.get("checklist", ()))),
            picture=str(data.get("picture", "")),
            value=AskedValue(**value) if value else None,
            then=str(data.get("then", "")),
        )


class Asking:
    """A prompt as one terminal asks it: each line of its checklist first, then the rest."""

    def __init__(self, prompt: Prompt) -> None:
        self._prompt = prompt
        self._left = list(prompt.checklist)

    @property
    def question(self) -> str:
        """Return what stands before the cursor."""
        if self._left:
            total = len(self._prompt.checklist)
            at = f"{total - len(self._left) + 1} of {total}"
            line = f"{self._left[0]} Enter where it holds, `{ABORT}` to end the run: "
            return f"   [{self._prompt.id}] {at}: {line}"
        return f"   [{self._prompt.id}] {self._prompt.hint}: "

    def take(self, line: str) -> str | None:
        """Return the answer once there is one; None where another line is asked for."""
        if not self._left:
            return self._prompt.meaning(line)
        answer = meaning(line)
        if answer == DONE:
            self._left.pop(0)
        return ABORT if answer == ABORT else None

    def understands(self, line: str) -> bool:
        """Whether a line is an answer to what is asked now."""
        return (meaning(line) if self._left else self._prompt.meaning(line)) is not None
