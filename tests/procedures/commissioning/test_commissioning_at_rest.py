"""No hand is asked for while something turns or carries a coil's current."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from unittest.mock import create_autospec

import pytest

from procedures.commissioning.part import ask_at_rest
from station.errors import InstrumentError
from station.method.duration import Duration
from station.procedure import Prompt
from station.roles import DirectCurrentSupply, Imu, SafetyReading, Turntable

HAND = Prompt("hand", "Reach for it.")


class Bench:
    """What of a run a request for a hand uses."""

    def __init__(self, **safe: bool) -> None:
        self.instruments: dict[str, Any] = {
            "turntable": create_autospec(Turntable, instance=True),
            "coil_supply.x": create_autospec(DirectCurrentSupply, instance=True),
            "imu": create_autospec(Imu, instance=True),
        }
        for name in ("turntable", "coil_supply.x"):
            reading = SafetyReading(safe.get(name.partition(".")[0], True), "turning")
            self.instruments[name].read_safety.return_value = reading
        self.asked: list[str] = []
        self.now_s = 0.0

    def role(self, name: str, kind: type[Any]) -> Any:
        return self.instruments[name]

    def read(self, function: Callable[[], None], takes: Duration) -> None:
        function()

    def ask(self, prompt: Prompt) -> None:
        made_safe = [self.instruments[n].make_safe.called for n in ("turntable", "coil_supply.x")]
        assert all(made_safe)
        self.asked.append(prompt.id)


def test_axes_and_coils_are_made_safe_before_a_hand_is_asked_for() -> None:
    run: Any = Bench()
    ask_at_rest(run, HAND)
    assert run.asked == ["hand"]


@pytest.mark.parametrize("which", ["turntable", "coil_supply"])
def test_nobody_is_asked_while_something_is_not_safe(which: str) -> None:
    run: Any = Bench(**{which: False})
    with pytest.raises(InstrumentError, match="reads back turning"):
        ask_at_rest(run, HAND)
    assert run.asked == []
