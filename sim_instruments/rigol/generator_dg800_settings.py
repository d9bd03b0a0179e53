"""What a Rigol DG800 keeps besides what reaches a coil: counter, harmonics, sweep, coupling, phase.

From pages of the DG800 Programming Guide: counter 2-3 to 2-5, coupling 2-12 and 2-13, burst 2-59
to 2-64, frequencies of a sweep 2-66 and 2-67, harmonics 2-89; from that of the DG2000 of the same
family: phase and pulse 2-122, harmonics 2-90; bounds and defaults that those pages do not show are
those of the DG1000Z (public notes that quote its guide). Start, stop, centre and span of a sweep
are two numbers. Coupled frequencies follow one another; mode, deviation and ratio are set before
(-221 is assumed). Assumed: nothing is at the counter's input, so it counts nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from sim_instruments.wire.scpi import (
    ScpiError,
    boolean,
    choice,
    numeric,
    single_parameter,
    whole_number,
    within,
    word,
    words,
)
from sim_instruments.wire.scpi_device import KeptSettings, KeptTable, Listed, Value

HIGHEST_HZ = 25e6
PHASE = "PHASe[:ADJust]"
NOTHING_COUNTED = ",".join(["0.000000000E+00"] * 5)
HARMONICS = range(2, 9)
COUNTER: KeptTable = {
    "COUPling": (word("AC", "DC"), "AC"),
    "GATEtime": (word(*(f"USER{n}" for n in range(1, 7))), "USER1"),
    "HF": (boolean, False),
    "LEVEl": (within(-2.5, 2.5, 0.0), 0.0),
    "SENSitive": (word("LOW", "HIGh"), "LOW"),
    "STATIstics[:STATe]": (boolean, False),
    "STATIstics:DISPlay": (word("DIGITAL", "CURVE"), "DIGITAL"),
}
SOURCE: KeptTable = {
    "BURSt:IDLE": (word("FPT", "TOP", "CENTER", "BOTTOM"), "FPT"),
    "BURSt:GATE:POLarity": (word("NORMal", "INVerted"), "NORM"),
    "BURSt:PHASe": (within(0.0, 360.0, 0.0), 0.0),
    "BURSt:TRIGger:TRIGOut": (word("POSitive", "NEGative", "OFF"), "OFF"),
    "FUNCtion:RAMP:SYMMetry": (within(0.0, 100.0, 50.0), 50.0),
    "HARMonic[:STATe]": (boolean, False),
    "HARMonic:ORDEr": (lambda text: round(numeric(text, 2, 8, 2)), 2),
    "HARMonic:TYPe": (word("EVEN", "ODD", "ALL", "USER"), "EVEN"),
    PHASE: (within(0.0, 360.0, 0.0), 0.0),
    "PULSe:TRANsition[:LEADing]": (within(10e-9, 1.0, 20e-9), 20e-9),
    "PULSe:TRANsition:TRAiling": (within(10e-9, 1.0, 20e-9), 20e-9),
}
OUTPUT: KeptTable = {
    ":SYNC[:STATe]": (boolean, True),
    ":SYNC:POLarity": (word("POSitive", "NEGative"), "POS"),
    ":SYNC:DELay": (within(0.0, 1e6, 0.0), 0.0),
    ":GATe:POLarity": (word("POSitive", "NEGative"), "POS"),
    ":MODE": (word("NORMal", "GATed"), "NORM"),
}


class Counter:
    """The frequency counter, at whose input is nothing."""

    def __init__(self) -> None:
        self.kept = KeptSettings(COUNTER)
        self.reset()

    def reset(self) -> None:
        """Switch it off."""
        self.kept.reset()
        self._state = "OFF"

    def commands(self) -> dict[str, Value]:
        """Return the table of COUNter."""
        return {
            **self.kept.commands(),
            "AUTO": lambda: None,
            "MEASure?": lambda: NOTHING_COUNTED,
            "STATIstics:CLEAr": lambda: None,
            "[:STATe]": (self._switch, lambda: self._state),
        }

    def _switch(self, text: str) -> None:
        names = {"ON": "RUN", "1": "RUN", "OFF": "OFF", "0": "OFF"}
        wanted = choice(text, names | {name: name for name in ("RUN", "STOP", "SINGLE")})
        if self._state == "OFF" and text.upper() in ("RUN", "STOP", "SINGLE"):
            raise ScpiError(-221)
        self._state = wanted


class Sweep:
    """Where the sweep of a channel begins and ends."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Sweep from 100 Hz to 1 kHz."""
        self.start_Hz, self.stop_Hz = 100.0, 1e3

    def commands(self) -> dict[str, Value]:
        """Return the frequencies below SOURce."""
        return {
            "FREQuency:STARt": (partial(self._set, "start"), lambda: self.start_Hz),
            "FREQuency:STOP": (partial(self._set, "stop"), lambda: self.stop_Hz),
            "FREQuency:CENTer": (partial(self._set, "centre"), lambda: self._centre_Hz),
            "FREQuency:SPAN": (partial(self._set, "span"), lambda: self._span_Hz),
        }

    @property
    def _centre_Hz(self) -> float:
        return (self.start_Hz + self.stop_Hz) / 2

    @property
    def _span_Hz(self) -> float:
        return abs(self.stop_Hz - self.start_Hz)

    def _set(self, what: str, text: str) -> None:
        default = {"start": 100.0, "stop": 1e3, "centre": 550.0, "span": 900.0}[what]
        lowest = 0.0 if what == "span" else 1e-6
        wanted = numeric(text, lowest, HIGHEST_HZ, default)
        start, stop = self.start_Hz, self.stop_Hz
        if what in ("start", "stop"):
            start, stop = (wanted, stop) if what == "start" else (start, wanted)
        else:
            centre = wanted if what == "centre" else self._centre_Hz
            span = wanted if what == "span" else self._span_Hz
            start, stop = centre - span / 2, centre + span / 2
        if not (start > 0.0 and stop <= HIGHEST_HZ):
            raise ScpiError(-222)
        self.start_Hz, self.stop_Hz = start, stop


class Harmonics:
    """Amplitudes and phases of the harmonics of a channel, which do not reach the coil's mean."""

    def __init__(self, largest_V: Callable[[], float], written: Callable[[float], str]) -> None:
        self._largest_V, self._written = largest_V, written
        self.reset()

    def reset(self) -> None:
        """Have all of them as after `*RST`."""
        self._amplitudes_V = dict.fromkeys(HARMONICS, 1.2647)
        self._phases_deg = dict.fromkeys(HARMONICS, 0.0)
        self._user = "X0000000"

    def commands(self) -> dict[str, Value]:
        """Return the commands that name the order of a harmonic."""
        return {
            "HARMonic:AMPL": self._of_order(
                self._amplitudes, lambda text: numeric(text, 0.0, 2 * self._largest_V(), 1.2647)
            ),
            "HARMonic:PHASe": self._of_order(self._phases, within(0.0, 360.0, 0.0)),
            "HARMonic:USER": (self._choose, lambda: self._user),
        }

    def _amplitudes(self) -> dict[int, float]:
        return self._amplitudes_V

    def _phases(self) -> dict[int, float]:
        return self._phases_deg

    def _of_order(
        self, values: Callable[[], dict[int, float]], read: Callable[[str], float]
    ) -> Listed:
        def order(parameters: list[str]) -> int:
            if not parameters:
                raise ScpiError(-109)
            return whole_number(parameters[0], HARMONICS[0], HARMONICS[-1])

        def take(parameters: list[str]) -> None:
            values()[order(parameters)] = read(single_parameter(parameters[1:]))

        def give(parameters: list[str]) -> str:
            n = order(parameters)
            return self._written(read(parameters[1]) if parameters[1:] else values()[n])

        return Listed(take, give)

    def _choose(self, text: str) -> None:
        if len(text) != 8 or text[0].upper() != "X" or set(text[1:]) - set("01"):
            raise ScpiError(-224)
        self._user = text.upper()


class FrequencyCoupling:
    """The frequencies of both channels, where they are coupled; `follow` sets that of a channel."""

    def __init__(self, follow: Callable[[int, float], None]) -> None:
        self._follow = follow
        self.reset()

    def reset(self) -> None:
        """Uncouple the channels."""
        self.on, self._mode, self._offset_Hz, self._ratio = False, "RAT", 0.0, 1.0

    def commands(self, deviation: str) -> dict[str, Value]:
        """Return the settings; `deviation` is what the offset is called."""

        def kept(name: str, read: Callable[[str], object]) -> Value:
            def take(text: str) -> None:
                if self.on:
                    raise ScpiError(-221)
                setattr(self, name, read(text))

            return take, lambda: getattr(self, name)

        return {
            ":MODE": kept("_mode", lambda text: choice(text, words("OFFSet", "RATio"))),
            f":{deviation}": kept("_offset_Hz", within(-HIGHEST_HZ, HIGHEST_HZ, 0.0)),
            ":RATio": kept("_ratio", within(1e-6, 1e6, 1.0)),
            "[:STATe]": (self._switch, lambda: self.on),
        }

    def changed(self, number: int, frequency_Hz: float) -> None:
        """Have the other channel follow one whose frequency is this by now."""
        if not self.on:
            return
        first = number == 1
        if self._mode == "OFFS":
            other_Hz = frequency_Hz + (self._offset_Hz if first else -self._offset_Hz)
        else:
            other_Hz = frequency_Hz * (self._ratio if first else 1.0 / self._ratio)
        self._follow(2 if first else 1, min(max(other_Hz, 1e-6), HIGHEST_HZ))

    def _switch(self, text: str) -> None:
        self.on = boolean(text)
