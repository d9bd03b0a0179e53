"""What a Keysight 34465A measures: FUNC, CONF and [SENS:]….

From the Truevolt guide and public client code: names of functions in quotes, the next range up for
a number, integration times from a list, settings that change forget older readings. Range and
resolution choose the integration time: `CONF:VOLT:DC 10,0.001` (Truevolt guide p. 217), which is
coarser than any, takes the shortest; a number beside autoranging is a conflict (34410A guide
p. 651), MIN, MAX and DEF are not. Assumed: a four-wire resistance has no ZERO:AUTO, an integration
time that is not in the list is refused, a resolution finer than the finest ends in -222, the one of
a frequency chooses its gate by decades.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from sim_instruments.generic.converter import (
    APERTURES_S,
    CYCLES,
    RESOLUTION,
    Converter,
    Function,
)
from sim_instruments.wire.scpi import ScpiError, boolean, numeric, single_parameter, unquoted
from sim_instruments.wire.scpi_device import Listed, ScpiDevice, Value

HEADERS = {
    "VOLT": "VOLTage[:DC]",
    "VOLT:AC": "VOLTage:AC",
    "CURR": "CURRent[:DC]",
    "CURR:AC": "CURRent:AC",
    "RES": "RESistance",
    "FRES": "FRESistance",
    "CAP": "CAPacitance",
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
    "CAPACITANCE": "CAP",
}
Give = Callable[[list[str]], str]
GATED = {"FREQ": "FREQuency", "PER": "PERiod"}
"""Functions whose aperture is a gate time."""
GATES_S = (1e-3, 1e-2, 0.1, 1.0)
FINEST_OF_GATE = 1e-6
"""Of the range, the resolution of the longest gate."""
WORDS = ("DEF", "DEFAULT", "MIN", "MINIMUM", "MAX", "MAXIMUM")
WITHOUT_PARAMETERS = ("CONT", "DIOD")


def functions() -> dict[str, Function]:
    """Return all functions as after `*RST`, by the name that `FUNC?` gives."""
    volts = (0.1, 1.0, 10.0, 100.0, 1000.0)
    amperes = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 3.0)
    farads = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4)
    ohms = (1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9)
    made = (
        Function("VOLT", "VDC", volts, 1, range=10.0),
        Function("VOLT:AC", "VAC", volts, 1, range=10.0),
        Function("CURR", "ADC", amperes, 2, range=0.1),
        Function("CURR:AC", "AAC", amperes, 2, range=0.1),
        Function("RES", "OHM", ohms, 512, range=1e3),
        Function("FRES", "OHM", ohms, 512, can_zero=False, range=1e3),
        Function("VOLT:RAT", "RATIO", volts, 1, range=10.0),
        Function("FREQ", "HZ", (3e5,), 1, zero_on=False, range=3e5, aperture_s=0.1),
        Function("PER", "S", (3.33e-1,), 1, zero_on=False, range=3.33e-1, aperture_s=0.1),
        Function("CAP", "F", farads, 1, zero_on=False, range=1e-6),
        Function("CONT", "OHM", (1e3,), 512, can_zero=False, range=1e3),
        Function("DIOD", "DIODE", (5.0,), 1, can_zero=False, range=5.0),
    )
    return {function.name: function for function in made}


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

    def reset(self) -> None:
        """Go to DC volts, everything automatic, ten power-line cycles."""
        for name, fresh in functions().items():
            vars(self.functions[name]).update(vars(fresh))
        self.chosen = self.functions["VOLT"]

    def add_to(self, device: ScpiDevice) -> None:
        """Add the commands to a device."""
        named = Listed(self._choose, lambda _: f'"{self.chosen.name}"')
        device.add_commands({"FUNCtion[:ON]": named}, "", "SENSe:")
        device.add_commands({"CONFigure": Listed(None, lambda _: self._configured())})
        for name, header in HEADERS.items():
            plain = name.endswith(":AC") or name == "CAP"
            table = self._function(self.functions[name], plain=plain)
            device.add_commands(
                table, f"{header}:", f"SENSe:{header}:", after=partial(self._set, name)
            )
        for name, header in GATED.items():
            gate = Listed(partial(self._take_gate, name), partial(self._gate, name))
            device.add_commands({f"{header}:APERture": gate}, "", "SENSe:", after=self._changed)

    def configure(self, function: Function, parameters: list[str]) -> None:
        """Choose a function with its range and resolution, everything else as after `*RST`.

        ScpiError -221 for a resolution in numbers where the range is chosen automatically.
        """
        if len(parameters) > (0 if function.name in WITHOUT_PARAMETERS else 2):
            raise ScpiError(-108)
        range_text, resolution_text = [*parameters, "DEF", "DEF"][:2]
        automatic = range_text.upper() in ("AUTO", "DEF", "DEFAULT")
        stated = resolution_text.upper() not in WORDS
        if automatic and stated and function.name not in GATED:
            raise ScpiError(-221)
        before = dict(vars(function))
        vars(function).update(vars(functions()[function.name]))
        try:
            if not automatic:
                self._set_range(function, range_text)
            if resolution_text.upper() not in ("DEF", "DEFAULT"):
                self._set_resolution(function, resolution_text)
        except ScpiError:
            vars(function).update(before)
            raise
        self._take(function)

    def _function(self, function: Function, *, plain: bool) -> dict[str, Value]:
        converter, ranges = self._converter, function.ranges

        def row(act: Callable[[Function, str], None], give: Give) -> Listed:
            return Listed(lambda given: act(function, single_parameter(given)), give)

        def among(low: float, high: float, present: Callable[[], float]) -> Give:
            return lambda p: f"{numeric(p[0], low, high, low) if p else present():+.8E}"

        def switch(present: Callable[[], object]) -> Give:
            return lambda _: str(int(bool(present())))

        in_range = among(ranges[0], ranges[-1], lambda: function.range)
        table: dict[str, Value] = {
            "RANGe[:UPPer]": row(self._set_range, in_range),
            "RANGe:AUTO": row(self._set_autorange, switch(lambda: function.autorange)),
        }
        if plain:
            return table
        integrated = among(CYCLES[0], CYCLES[-1], lambda: function.cycles)
        aperture = among(*APERTURES_S, lambda: converter.aperture_s(function))
        table |= {
            "NPLCycles": row(self._set_cycles, integrated),
            "APERture": row(self._set_aperture, aperture),
            "APERture:ENABled": row(self._enable_aperture, switch(lambda: function.aperture_s)),
            "RESolution": row(
                self._set_resolution,
                lambda given: (
                    f"{self._resolution_of(function, given[0]):+.8E}"
                    if given
                    else f"{self._resolution(function):+.8E}"
                ),
            ),
        }
        if function.can_zero:
            table["ZERO:AUTO"] = row(self._set_zero, switch(lambda: function.zero_on))
        if function.name == "VOLT":
            # Neither impedance loads what the simulated worlds have to measure.
            self._high_impedance = False
            shown = switch(lambda: self._high_impedance)
            table["IMPedance:AUTO"] = row(self._set_impedance, shown)
        return table

    def _set(self, name: str) -> None:
        """Measure anew after a setting of a function, with a new zero."""
        self.functions[name].zeroed_at_s = self._now_s()
        self._changed()

    def _resolution(self, function: Function) -> float:
        if function.name in GATED:
            return self._finest(function)[function.aperture_s or 0.1]
        return self._converter.resolution(function) * function.range

    def _take_gate(self, name: str, parameters: list[str]) -> None:
        gate_s = numeric(single_parameter(parameters), GATES_S[0], GATES_S[-1], 0.1)
        if not any(math.isclose(gate_s, known) for known in GATES_S):
            raise ScpiError(-224)
        self.functions[name].aperture_s = gate_s

    def _gate(self, name: str, parameters: list[str]) -> str:
        shown_s = self.functions[name].aperture_s or 0.0
        return f"{numeric(parameters[0], *GATES_S[::3], 0.1) if parameters else shown_s:+.8E}"

    def _choose(self, parameters: list[str]) -> None:
        name = unquoted(single_parameter(parameters)).upper().removesuffix(":DC")
        head, colon, rest = name.partition(":")
        name = NAMES.get(head, head) + colon + rest.removeprefix("DC:").removesuffix("IO")
        if name not in self.functions:
            raise ScpiError(-224)
        self._take(self.functions[name])

    def _take(self, function: Function) -> None:
        self.chosen = function
        self._set(function.name)

    def _configured(self) -> str:
        used = self.chosen
        return f'"{used.name} {used.range:+.8E},{self._resolution(used):+.8E}"'

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

    def _finest(self, function: Function) -> dict[float, float]:
        """Return the resolution of each integration time, or of each gate, coarsest first."""
        if function.name in GATED:
            shares = (FINEST_OF_GATE * GATES_S[-1] / gate_s for gate_s in GATES_S)
            return dict(zip(GATES_S, (share * function.range for share in shares), strict=True))
        return {c: share * function.range for c, share in zip(CYCLES, RESOLUTION, strict=True)}

    def _resolution_of(self, function: Function, text: str) -> float:
        best = self._finest(function)
        finest, coarsest = min(best.values()), max(best.values())
        default = best[0.1 if function.name in GATED else 10.0]
        wanted = numeric(text, min(finest, 0.0), math.inf, default)
        wanted = {"MIN": finest, "MAX": coarsest}.get(text.upper()[:3], wanted)
        if wanted < finest * (1 - 1e-6):
            raise ScpiError(-222)
        return wanted

    def _set_resolution(self, function: Function, text: str) -> None:
        wanted = self._resolution_of(function, text)
        best = self._finest(function)
        # What is coarser than any takes the shortest.
        chosen = next(time for time in best if best[time] <= wanted * (1 + 1e-6))
        if function.name in GATED:
            function.aperture_s = chosen
        else:
            function.cycles, function.aperture_s = chosen, None

    def _set_zero(self, function: Function, text: str) -> None:
        function.zero_on = text.upper() != "ONCE" and boolean(text)

    def _set_impedance(self, function: Function, text: str) -> None:
        self._high_impedance = boolean(text)
