"""How an ACUTROL3000 writes its answers: prefix, numbers, what a command and its queue answer.

Which of the forms a controller has is not confirmed in a primary source, so each is a key of the
truth, all optional but `framing`:

* `framing`: `framed` with a prefix, or `line` as on IEEE-488, where only queries are answered;
* `prefix`: error code and length as `digits`, four each, or as 32-bit words, `high-byte-first` or
  `low-byte-first`;
* `commands_answer`: `ok`, or `line-end` (CR LF, since build 1848), for what has no answer;
* `empty_queue`: `nothing`, `zero` (`0`) or `no-error` (`0,NO ERROR`);
* `error_form`: `colon` (`215:text`) or `comma` (`215,text`);
* `decimals`: to how many numbers are rounded, in and out.
"""

from __future__ import annotations

import struct
from collections import deque

from sim_instruments.acutronic.language import TEXTS, Answer, decimal, rounded
from sim_instruments.truth import Truth

FORMS = {
    "framing": ("framed", "line"),
    "prefix": ("digits", "high-byte-first", "low-byte-first"),
    "commands_answer": ("ok", "line-end"),
    "empty_queue": ("nothing", "zero", "no-error"),
    "error_form": ("colon", "comma"),
}
EMPTY = {"nothing": "", "zero": "0", "no-error": "0,NO ERROR"}
DECIMALS = 6
ERRORS_KEPT = 20


class Answers:
    """The forms of one controller."""

    def __init__(self, truth: Truth) -> None:
        chosen = {
            key: truth.word(key, forms, None if key == "framing" else forms[0])
            for key, forms in FORMS.items()
        }
        self.framing = chosen["framing"]
        self._prefix = chosen["prefix"]
        self._command = "OK" if chosen["commands_answer"] == "ok" else "\r\n"
        self._empty = EMPTY[chosen["empty_queue"]]
        self._between = ":" if chosen["error_form"] == "colon" else ","
        self._decimals = truth.integer("decimals", 0, DECIMALS)

    def taken(self, arguments: list[str]) -> list[str]:
        """Return the arguments of a command as the controller takes them."""
        return [rounded(number, self._decimals) for number in arguments]

    def written(self, answer: Answer) -> str:
        """Return the answer to a query."""
        if isinstance(answer, str):
            return answer
        values = [answer] if isinstance(answer, float | int) else answer
        between = ";" if isinstance(answer, tuple) else ","
        return between.join(
            value if isinstance(value, str) else decimal(value, self._decimals) for value in values
        )

    def entries(self, codes: list[int]) -> str:
        """Return entries of the error queue; that `;` parts several is not confirmed."""
        return ";".join(f"{code}{self._between}{TEXTS[code]}" for code in codes) or self._empty

    def sent(self, code: int, answers: list[str]) -> bytes:
        """Return what goes out for a message: its first error, 0 for none, and its answers."""
        if self.framing == "line":
            if answers:
                return f"{';'.join(answers)}\r\n".encode("ascii")
            return b"" if self._command == "OK" else b"\r\n"
        body = TEXTS[code] if code else ";".join(answers) if answers else self._command
        if self._prefix == "digits":
            return f"{code:04d}{len(body):04d}{body}".encode("ascii")
        order = ">" if self._prefix == "high-byte-first" else "<"
        return struct.pack(f"{order}II", code, len(body)) + body.encode("ascii")


class ErrorQueue:
    """Errors in the order in which they came, no more than `ERRORS_KEPT`."""

    def __init__(self) -> None:
        self._codes: deque[int] = deque()

    def __len__(self) -> int:
        return len(self._codes)

    def add(self, code: int) -> int:
        """Keep an error, unless the queue is full, and return it."""
        if len(self._codes) < ERRORS_KEPT:
            self._codes.append(code)
        return code

    def take(self, count: int) -> list[int]:
        """Return, and forget, as many of the oldest errors."""
        return [self._codes.popleft() for _ in range(min(count, len(self)))]

    def clear(self) -> None:
        """Forget all errors."""
        self._codes.clear()
