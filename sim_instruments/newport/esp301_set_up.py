"""How a stage and the front panel are set up in a Newport ESP301, which changes no movement here.

From public clients: `ZB` feedback and `ZH` limit switches in hexadecimal digits, of which the
answer ends with H, `SU` resolution of the encoder, `FR` of a full step, `QS` microsteps 1 to 250,
`PH` state of the inputs, `SM` save, `LC` keys of the panel. What a URS100BPP holds in ZB, ZH and QS
and what PH answers while nothing is wrong is assumed.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from sim_instruments.newport.esp301_axis import AXIS, EspError

Act = Callable[[str], str | None]
LARGEST_WORD = 0xFFFF
MICROSTEPS = range(1, 251)


class SetUp:
    """What is set up of the axis, whose encoder resolves `step_deg`."""

    def __init__(self, step_deg: float, number: Callable[[str], float]) -> None:
        self._number = number
        self._words = {"ZB": 0, "ZH": 0}
        self._microsteps = 100
        self._resolution = {"SU": step_deg, "FR": step_deg * self._microsteps}

    def of_controller(self) -> dict[str, Act]:
        """Return the commands without an axis."""
        return {"PH": lambda _: "0H, 0H", "SM": lambda _: None, "LC": lambda _: None}

    def of_axis(self) -> dict[str, Act]:
        """Return the commands of the axis."""
        return {
            "QS": self._set_microsteps,
            "QS?": lambda _: str(self._microsteps),
            **{name: partial(self._set_word, name) for name in self._words},
            **{f"{name}?": partial(self._word, name) for name in self._words},
            **{name: partial(self._set_resolution, name) for name in self._resolution},
            **{f"{name}?": partial(self._shown, name) for name in self._resolution},
        }

    def _word(self, name: str, parameter: str) -> str:
        return f"{self._words[name]:X}H"

    def _shown(self, name: str, parameter: str) -> str:
        return f"{self._resolution[name]:.9f}"

    def _set_word(self, name: str, text: str) -> None:
        if not text:
            raise EspError(38)
        try:
            value = int(text.removesuffix("H"), 16)
        except ValueError:
            raise EspError(7) from None
        if not 0 <= value <= LARGEST_WORD:
            raise EspError(100 * AXIS + 1)
        self._words[name] = value

    def _set_microsteps(self, text: str) -> None:
        value = self._number(text)
        if value not in MICROSTEPS:
            raise EspError(100 * AXIS + 1)
        self._microsteps = int(value)

    def _set_resolution(self, name: str, text: str) -> None:
        value = self._number(text)
        if not 2e-9 <= value <= 2e9:
            raise EspError(100 * AXIS + 1)
        self._resolution[name] = value
