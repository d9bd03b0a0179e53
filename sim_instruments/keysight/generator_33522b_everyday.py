"""What other programs send a Keysight 33522B every day: APPLy, phases, duty cycles, sweeps, sync.

From the 33500 series guide and public client code: headers and ranges; APPLy sets function,
frequency, amplitude and offset and switches the output on; `APPL?` answers in quotes; sweep and
burst exclude one another, the one that is switched on last stays. What a sweep or a phase does is
not simulated: what runs without burst reaches the coil with its mean.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from sim_instruments.keysight.generator_33522b_channel import GeneratorChannel
from sim_instruments.keysight.generator_33522b_wave import FUNCTIONS
from sim_instruments.wire.scpi import CommandTree, ScpiError, boolean, choice, numeric

Held = dict[str, tuple[Callable[[str], None], Callable[[], str | float]]]
SPACINGS = {"LIN": "LIN", "LINEAR": "LIN", "LOG": "LOG", "LOGARITHMIC": "LOG"}
SYNC_MODES = {"NORM": "NORM", "NORMAL": "NORM", "CARR": "CARR", "CARRIER": "CARR"}
SYNC_MODES |= {"MARK": "MARK", "MARKER": "MARK"}
POLARITIES = {"NORM": "NORM", "NORMAL": "NORM", "INV": "INV", "INVERTED": "INV"}
FREQUENCIES_HZ = (1e-6, 30e6)
NUMBERS: dict[str, tuple[float, float, float]] = {
    "PHASe": (-360.0, 360.0, 0.0),
    "FUNCtion:RAMP:SYMMetry": (0.0, 100.0, 100.0),
    "FUNCtion:PULSe:TRANsition[:BOTH]": (8.4e-9, 1e-6, 10e-9),
    "FUNCtion:PULSe:TRANsition:LEADing": (8.4e-9, 1e-6, 10e-9),
    "FUNCtion:PULSe:TRANsition:TRAiling": (8.4e-9, 1e-6, 10e-9),
    "SWEep:TIME": (1e-3, 250e3, 1.0),
    "FREQuency:STARt": (*FREQUENCIES_HZ, 100.0),
    "FREQuency:STOP": (*FREQUENCIES_HZ, 1e3),
    "BURSt:INTernal:PERiod": (1e-6, 8e3, 10e-3),
    "BURSt:PHASe": (-360.0, 360.0, 0.0),
}
"""Least, largest and the value after `*RST`."""
WORDS: dict[str, tuple[dict[str, str], str]] = {"SWEep:SPACing": (SPACINGS, "LIN")}


class Everyday:
    """Settings of one channel that do not change what its coil gets, and `APPLy`."""

    def __init__(self, channel: GeneratorChannel) -> None:
        self._channel = channel
        self.reset()

    def reset(self) -> None:
        """Go to the state after `*RST`."""
        self._numbers = {name: default for name, (_, _, default) in NUMBERS.items()}
        self._words = {name: default for name, (_, default) in WORDS.items()}
        self.sweeps = False

    def source(self) -> Held:
        """Return what stands below SOURce."""
        wave, channel = self._channel.wave, self._channel
        held: Held = {}
        for name in NUMBERS:
            held[name] = (partial(self._set, name), partial(self._number, name))
        for name in WORDS:
            held[name] = (partial(self._choose, name), partial(self._word, name))
        held["SWEep:STATe"] = (self._sweep, lambda: str(int(self.sweeps and not channel.burst)))
        held["FUNCtion:SQUare:DCYCle"] = (wave.set_duty, lambda: wave.duty_percent)
        held["FUNCtion:PULSe:DCYCle"] = (wave.set_pulse_duty, wave.pulse_duty)
        return held

    def add_to(self, tree: CommandTree, roots: list[str], done: Callable[[], None]) -> None:
        """Add APPLy and PHASe:SYNChronize; `done` is called after each."""

        def apply(name: str, parameters: list[str]) -> None:
            self._apply(name, parameters)
            done()

        words = {"SINusoid": "SIN", "SQUare": "SQU", "TRIangle": "TRI", "RAMP": "RAMP"}
        words |= {"PULSe": "PULS", "PRBS": "PRBS", "NOISe": "NOIS", "ARBitrary": "ARB", "DC": "DC"}
        for root in roots:
            for word, name in words.items():
                tree.add(f"{root}APPLy:{word}", partial(apply, FUNCTIONS[name]))
            tree.add(f"{root}APPLy?", lambda _: self._applied())
            tree.add(f"{root}PHASe:SYNChronize", lambda _: None)

    def _apply(self, name: str, parameters: list[str]) -> None:
        channel = self._channel
        if len(parameters) > 3:
            raise ScpiError(-108)
        frequency, amplitude, offset = [*parameters, "DEF", "DEF", "DEF"][:3]
        channel.set_function(name)
        if frequency.upper() not in ("DEF", "DEFAULT"):
            frequency_Hz = numeric(frequency, *FREQUENCIES_HZ, 1e3)
            if name != "DC":
                channel.wave.set_period(1.0 / frequency_Hz)
        if name != "DC" and amplitude.upper() not in ("DEF", "DEFAULT"):
            channel.set_amplitude(amplitude)
        channel.set_offset("0" if offset.upper() in ("DEF", "DEFAULT") else offset)
        self.sweeps = channel.burst = False
        channel.source, channel.on = "IMM", True

    def _applied(self) -> str:
        channel = self._channel
        shown = (1.0 / channel.wave.period_s, channel.amplitude_V, channel.offset_V)
        return f'"{channel.wave.function} {",".join(f"{setting:+.13E}" for setting in shown)}"'

    def _number(self, name: str) -> float:
        return self._numbers[name]

    def _word(self, name: str) -> str:
        return self._words[name]

    def _set(self, name: str, text: str) -> None:
        self._numbers[name] = numeric(text, *NUMBERS[name])

    def _choose(self, name: str, text: str) -> None:
        self._words[name] = choice(text, WORDS[name][0])

    def _sweep(self, text: str) -> None:
        self.sweeps = boolean(text)
        if self.sweeps:
            self._channel.burst = False


class SyncOutput:
    """The connector Sync: whether it is on, whose it is, and how."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Go to the state after `*RST`."""
        self.on, self.source = True, "CH1"
        self._of = {number: {"MODE": "NORM", "POLarity": "NORM"} for number in (1, 2)}

    def common(self) -> Held:
        """Return what stands below OUTPut for both channels."""
        return {
            "SYNC[:STATe]": (self._switch, lambda: str(int(self.on))),
            "SYNC:SOURce": (self._choose, lambda: self.source),
        }

    def of(self, number: int) -> Held:
        """Return what stands below OUTPut for one channel."""
        return {
            f"SYNC:{name}": (
                partial(self._set, number, name, names),
                partial(self._has, number, name),
            )
            for name, names in (("MODE", SYNC_MODES), ("POLarity", POLARITIES))
        }

    def _switch(self, text: str) -> None:
        self.on = boolean(text)

    def _choose(self, text: str) -> None:
        self.source = choice(text, {"CH1": "CH1", "CH2": "CH2"})

    def _set(self, number: int, name: str, names: dict[str, str], text: str) -> None:
        self._of[number][name] = choice(text, names)

    def _has(self, number: int, name: str) -> str:
        return self._of[number][name]
