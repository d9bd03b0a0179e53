"""What a Keysight 34465A measures: FUNC, CONF and [SENS:]….

From the Truevolt guide and public client code: names of functions in quotes, the next range up for
a number, integration times from a list, settings that change forget older readings. Assumed: a
four-wire resistance has no ZERO:AUTO, an integration time that is not in the list is refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from sim_instruments.keysight.multimeter_34465a_converter import (
    APERTURES_S,
    CYCLES,
    RESOLUTION,
    Converter,
    Function,
    functions,
)
from sim_instruments.wire.scpi import CommandTree, ScpiError, boolean, numeric, single_parameter

HEADERS = {
    "VOLT": "VOLTage[:DC]",
    "VOLT:AC": "VOLTage:AC",
    "CURR": "CURRent[:DC]",
    "CURR:AC": "CURRent:AC",
    "RES": "RESistance",
    "FRES": "FRESistance",
}
NAMES = {
    "VOLTAGE": "VOLT",
    "CURRENT": "CURR",
    "RESISTANCE": "RES",
    "FRESISTANCE": "FRES",
    "FREQUENCY": "FREQ",
    "PERIOD": "PER",
    "CONTINUITY": "CONT",
    "DIODE": "DIOD",
}
GATES_S = ("FREQuency", "PERiod")
"""Functions whose aperture is a gate time: 1 ms, 10 ms, 100 ms or 1 s."""


def unquoted(text: str) -> str:
    """Return what stands between quotes; ScpiError -151 without them."""
    if len(text) < 2 or text[0] not in "\"'" or text[-1] != text[0]:
        raise ScpiError(-151)
    return text[1:-1]


class Sense:
    """The functions with their settings, the chosen one, and the commands that change them.

    `changed` is called after each change, `now_s` tells the time of a new zero.
    """

    def __init__(
        self, converter: Converter, changed: Callable[[], None], now_s: Callable[[], float]
    ) -> None:
        self._converter, self._changed, self._now_s = converter, changed, now_s
        self.functions = functions()
        self.chosen = self.functions["VOLT"]
        self._gates_s = dict.fromkeys(GATES_S, 0.1)

    def reset(self) -> None:
        """Go to DC volts, everything automatic, ten power-line cycles."""
        for name, fresh in functions().items():
            vars(self.functions[name]).update(vars(fresh))
        self._gates_s = dict.fromkeys(GATES_S, 0.1)
        self.chosen = self.functions["VOLT"]

    def add_to(self, tree: CommandTree) -> None:
        """Add the commands to a device's."""
        for root in ("", "SENSe:"):
            tree.add(f"{root}FUNCtion[:ON]", self._choose)
            tree.add(f"{root}FUNCtion[:ON]?", lambda _: f'"{self.chosen.name}"')
            for name, header in HEADERS.items():
                self._add_function(tree, root + header, self.functions[name])
            for header in GATES_S:
                self._add_gate(tree, f"{root}{header}:APERture", header)
        tree.add("CONFigure?", lambda _: self._configured())

    def configure(self, function: Function, parameters: list[str]) -> None:
        """Choose a function with its range and resolution, everything else as after `*RST`."""
        if len(parameters) > 2:
            raise ScpiError(-108)
        vars(function).update(vars(functions()[function.name]))
        if parameters and parameters[0].upper() not in ("AUTO", "DEF"):
            self._set_range(function, parameters[0])
        if len(parameters) == 2 and parameters[1].upper() != "DEF":
            self._set_resolution(function, parameters[1])
        self._take(function)

    def _add_function(self, tree: CommandTree, header: str, function: Function) -> None:
        converter = self._converter

        def setter(act: Callable[[Function, str], None]) -> Callable[[list[str]], None]:
            def handler(parameters: list[str]) -> None:
                act(function, single_parameter(parameters))
                function.zeroed_at_s = self._now_s()
                self._changed()

            return handler

        def limits(parameters: list[str], present: float, low: float, high: float) -> str:
            return f"{numeric(parameters[0], low, high, low) if parameters else present:+.8E}"

        lowest, highest = function.ranges[0], function.ranges[-1]
        tree.add(f"{header}:RANGe[:UPPer]", setter(self._set_range))
        tree.add(f"{header}:RANGe[:UPPer]?", lambda p: limits(p, function.range, lowest, highest))
        tree.add(f"{header}:RANGe:AUTO", setter(self._set_autorange))
        tree.add(f"{header}:RANGe:AUTO?", lambda _: str(int(function.autorange)))
        if header.endswith(":AC"):
            return
        tree.add(f"{header}:NPLCycles", setter(self._set_cycles))
        tree.add(
            f"{header}:NPLCycles?", lambda p: limits(p, function.cycles, CYCLES[0], CYCLES[-1])
        )
        tree.add(f"{header}:APERture", setter(self._set_aperture))
        tree.add(
            f"{header}:APERture?",
            lambda p: limits(p, converter.aperture_s(function), *APERTURES_S),
        )
        tree.add(f"{header}:APERture:ENABled", setter(self._enable_aperture))
        tree.add(f"{header}:APERture:ENABled?", lambda _: str(int(bool(function.aperture_s))))
        tree.add(f"{header}:RESolution", setter(self._set_resolution))
        tree.add(
            f"{header}:RESolution?",
            lambda _: f"{converter.resolution(function) * function.range:+.8E}",
        )
        if function.can_zero:
            tree.add(f"{header}:ZERO:AUTO", setter(self._set_zero))
            tree.add(f"{header}:ZERO:AUTO?", lambda _: str(int(function.zero_on)))
        if function.name == "VOLT":
            # Neither impedance loads what the simulated worlds have to measure.
            self._high_impedance = False
            tree.add(f"{header}:IMPedance:AUTO", setter(self._set_impedance))
            tree.add(f"{header}:IMPedance:AUTO?", lambda _: str(int(self._high_impedance)))

    def _add_gate(self, tree: CommandTree, header: str, name: str) -> None:
        def take(parameters: list[str]) -> None:
            gate_s = numeric(single_parameter(parameters), 1e-3, 1.0, 0.1)
            if not any(math.isclose(gate_s, known) for known in (1e-3, 1e-2, 0.1, 1.0)):
                raise ScpiError(-224)
            self._gates_s[name] = gate_s
            self._changed()

        tree.add(header, take)
        tree.add(f"{header}?", lambda _: f"{self._gates_s[name]:+.8E}")

    def _choose(self, parameters: list[str]) -> None:
        name = unquoted(single_parameter(parameters)).upper().removesuffix(":DC")
        head, colon, rest = name.partition(":")
        name = NAMES.get(head, head) + colon + rest.removeprefix("DC:").removesuffix("IO")
        if name not in self.functions:
            raise ScpiError(-224)
        self._take(self.functions[name])

    def _take(self, function: Function) -> None:
        self.chosen = function
        function.zeroed_at_s = self._now_s()
        self._changed()

    def _configured(self) -> str:
        used = self.chosen
        resolution = self._converter.resolution(used) * used.range
        return f'"{used.name} {used.range:+.8E},{resolution:+.8E}"'

    def _set_range(self, function: Function, text: str) -> None:
        lowest, highest = function.ranges[0], function.ranges[-1]
        least = text.upper() in ("MIN", "MINIMUM")
        wanted = lowest if least else abs(numeric(text, -highest, highest, lowest))
        function.range = next(
            full_scale for full_scale in function.ranges if wanted <= full_scale * (1 + 1e-9)
        )
        function.autorange = False

    def _set_autorange(self, function: Function, text: str) -> None:
        function.autorange = text.upper() != "ONCE" and boolean(text)
        if text.upper() == "ONCE":
            function.range = self._converter.range_now(function, self._now_s())

    def _set_cycles(self, function: Function, text: str) -> None:
        wanted = numeric(text, CYCLES[0], CYCLES[-1], 10.0)
        if wanted not in CYCLES:
            raise ScpiError(-224)
        function.cycles, function.aperture_s = wanted, None

    def _set_aperture(self, function: Function, text: str) -> None:
        function.aperture_s = numeric(text, *APERTURES_S, 0.1)

    def _enable_aperture(self, function: Function, text: str) -> None:
        function.aperture_s = self._converter.aperture_s(function) if boolean(text) else None

    def _set_resolution(self, function: Function, text: str) -> None:
        best = {
            c: relative * function.range for c, relative in zip(CYCLES, RESOLUTION, strict=True)
        }
        wanted = numeric(text, min(best.values()), max(best.values()), best[10.0])
        function.cycles = next(c for c in CYCLES if best[c] <= wanted * (1 + 1e-6))
        function.aperture_s = None

    def _set_zero(self, function: Function, text: str) -> None:
        function.zero_on = text.upper() != "ONCE" and boolean(text)

    def _set_impedance(self, function: Function, text: str) -> None:
        self._high_impedance = boolean(text)
