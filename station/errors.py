"""The errors an operator may see; each knows the exit code of the command line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from traceback import extract_tb
from typing import Any

EXIT_DONE = 0
EXIT_OUTSIDE_LIMIT = 1
EXIT_WRONG_INPUT = 2
EXIT_FAULT = 3
EXIT_ABORTED = 4
EXIT_INTERLOCK = 5
EXIT_UNDETERMINED = 6


class StationError(Exception):
    """Anything that ends a command with one sentence for the operator."""

    exit_code = EXIT_FAULT


class InputError(StationError):
    """A wrong plan, bench file, dataset or command line."""

    exit_code = EXIT_WRONG_INPUT


class NotPermitted(InputError):
    """A file or folder that this user may not open: nothing is known of what it holds."""

    def __init__(self, path: Path | str) -> None:
        super().__init__(
            f"{path} cannot be read by this user: permission denied; run the command as the user "
            "whose it is, or let this one read it"
        )


class UnansweredPrompt(InputError):
    """A prompt that needs a person while no operator can be asked."""


class QuantityNotRead(InputError):
    """A quantity that a driver does not read, or that no setting of the bench file wires."""

    @classmethod
    def refuse(cls, name: str, driver: object, quantity: str, settings: Mapping[str, Any]) -> None:
        """Raise where a driver, a class or an instance, cannot be asked for a quantity.

        `name` is the instrument's, `settings` those of the bench file.
        """
        reads = getattr(driver, "quantities", {})
        setting = getattr(driver, "wired_by", {}).get(quantity)
        if quantity not in reads:
            known = ", ".join(reads) or "none"
            raise cls(
                f"the driver of {name} does not read '{quantity}'; it reads {known}; take this "
                "interlock out of the bench file"
            )
        if setting is not None and settings.get(setting) is None:
            raise cls(
                f"settings.{setting} is missing, without which the driver of {name} does not read "
                f"'{quantity}'; write it, or take this interlock out of the bench file"
            )


class InstrumentError(StationError):
    """An instrument that answered wrongly, refused, or did not answer.

    The message names the instrument, what was attempted, what came back, and what to do now.
    """

    def __init__(self, instrument: str, attempted: str, came_back: str, do_now: str) -> None:
        super().__init__(f"{instrument}: {attempted}: {came_back}; {do_now}")
        self.instrument = instrument


class InstrumentTimeout(InstrumentError):
    """An instrument that stayed silent until its deadline."""


class AnotherInstrument(InstrumentError):
    """An instrument that clearly is another model than the driver's."""


class InstrumentInUse(InstrumentError):
    """An instrument that another process has; `who` is what that says of itself, if anything."""

    def __init__(self, instrument: str, attempted: str, who: str) -> None:
        super().__init__(
            instrument,
            attempted,
            f"another process has it ({who})" if who else "another process has it",
            "wait until that has ended, or end it with `station abort RUN`",
        )
        self.who = who


class InstrumentsMissing(StationError):
    """Every instrument that could not be opened or is not the one in the bench file.

    `count` is their number where a problem tells of several.
    """

    def __init__(self, problems: list[str], count: int | None = None) -> None:
        listed = "".join(f"\n  - {problem}" for problem in problems)
        count = count or len(problems)
        noun = "instrument is" if count == 1 else "instruments are"
        super().__init__(f"{count} {noun} missing, wrong or in use, nothing was energised:{listed}")


class BenchEnergised(StationError):
    """Something on the bench is energised that this run neither uses nor may switch off."""

    def __init__(self, energised: list[str]) -> None:
        listed = "".join(f"\n  - {instrument}" for instrument in energised)
        super().__init__(
            "the bench is not at rest before the first step; look at it, and switch off by hand, "
            f"or by the run that uses it, then start again:{listed}"
        )


class ConditionNotReached(StationError):
    """A condition of the procedure that did not come true in the time the plan allows."""


class RecordError(StationError):
    """A run folder that cannot be written, read or trusted."""


class DamagedRecord(RecordError, InputError):
    """A run folder in which something is not any more what the run wrote."""

    exit_code = EXIT_WRONG_INPUT


class MissingRows(RecordError):
    """A finished unit of work without the raw rows that its analysis needs."""

    def __init__(self, unit: str, what: str) -> None:
        super().__init__(f"{unit}: {what}")
        self.unit = unit
        self.what = what


class PauseRefused(StationError):
    """An instrument that cannot be left alone now; the run goes on."""


class Aborted(StationError):
    """A person ended the run."""

    exit_code = EXIT_ABORTED


class InterlockTripped(StationError):
    """A level that the bench file forbids was reached, or could not be read any more.

    `name` is the interlock's, `said` what was seen, `time_s` the run time at which.
    """

    exit_code = EXIT_INTERLOCK

    def __init__(
        self,
        name: str,
        said: str,
        time_s: float,
        *,
        value: float | str | None = None,
        limit: str | None = None,
    ) -> None:
        super().__init__(f"the interlock {name} tripped at {time_s:.3f} s: {said}")
        self.name = name
        self.said = said
        self.time_s = time_s
        self.value = value
        self.limit = limit


class NotAcknowledged(StationError):
    """A bench whose interlock tripped and whose cause nobody has acknowledged yet."""

    exit_code = EXIT_INTERLOCK


def reason_of(error: BaseException) -> str:
    """Return what an error of any library says, as a part of a sentence on one line.

    The name of its class tells a person nothing: that is in the traceback.
    """
    text = " ".join(str(error).split())
    if isinstance(error, KeyError):
        return f"{text} is missing"
    return text or "it gives no reason"


NUMERICS = ("numpy", "scipy")


def place_of(error: BaseException) -> str:
    """Return file and line that raised an error, such as `, in evaluate.py:52`, for a sentence.

    Of one that NumPy or SciPy raised, the line that called them.
    """
    frames = [(Path(frame.filename), frame.lineno) for frame in extract_tb(error.__traceback__)]
    own = [f"{path.name}:{line}" for path, line in frames if not set(NUMERICS) & set(path.parts)]
    return f", in {own[-1]}" if own else ""
