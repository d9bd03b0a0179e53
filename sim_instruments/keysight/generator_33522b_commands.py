"""The commands of one channel of a Keysight 33522B: SOURce, OUTPut and TRIGger with its number.

From the 33500 series guide and public client code: the number may be left out for channel 1, and
so may SOURce. Numbers are told as `+1.0000000000000E+00`, an open end as 9.9E+37.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sim_instruments.keysight.generator_33522b_channel import LOADS_OHM, OPEN, Channel
from sim_instruments.keysight.generator_33522b_wave import FUNCTIONS, PERIODS_S
from sim_instruments.wire.scpi import CommandTree, boolean, choice, none, numeric, one

SOURCES = {"IMM": "IMM", "IMMEDIATE": "IMM", "EXT": "EXT", "EXTERNAL": "EXT"}
SOURCES |= {"TIM": "TIM", "TIMER": "TIM", "BUS": "BUS"}
SLOPES = {"POS": "POS", "POSITIVE": "POS", "NEG": "NEG", "NEGATIVE": "NEG"}
MODES = {"TRIG": "TRIG", "TRIGGERED": "TRIG", "GAT": "GAT", "GATED": "GAT"}
POLARITIES = {"NORM": "NORM", "NORMAL": "NORM", "INV": "INV", "INVERTED": "INV"}

Act = Callable[[list[str]], None]
Tell = Callable[[], str | float]


def add_channel_commands(
    tree: CommandTree,
    number: int,
    channel: Channel,
    now_s: Callable[[], float],
    switch: Callable[[Channel, bool], None],
) -> None:
    """Add the commands of a channel; after each one its coil has what the settings say."""
    wave = channel.wave

    def add(roots: list[str], commands: dict[str, tuple[Act, Tell | None]]) -> None:
        for root in roots:
            for header, (act, tell) in commands.items():
                tree.add(root + header, doing(act))
                if tell is not None:
                    tree.add(f"{root}{header}?", telling(tell))

    def doing(act: Act) -> Act:
        def handler(parameters: list[str]) -> None:
            act(parameters)
            channel.apply(now_s())

        return handler

    def setting(name: str, read: Callable[[str], Any]) -> Act:
        return lambda parameters: setattr(channel, name, read(one(parameters)))

    first = number == 1
    source = [f"SOURce{number}:", *(["SOURce:", ""] if first else [])]
    output = [f"OUTPut{number}", *(["OUTPut"] if first else [])]
    trigger = [f"TRIGger{number}", *(["TRIGger"] if first else [])]
    add(
        source,
        {
            "FUNCtion": (
                given(lambda text: channel.set_function(choice(text, FUNCTIONS))),
                lambda: wave.function,
            ),
            "VOLTage": (given(channel.set_amplitude), lambda: channel.amplitude_V),
            "VOLTage:OFFSet": (given(channel.set_offset), lambda: channel.offset_V),
            "VOLTage:HIGH": (given(channel.set_high), lambda: channel.high_V),
            "VOLTage:LOW": (given(channel.set_low), lambda: channel.low_V),
            "VOLTage:UNIT": (given(only_vpp), lambda: "VPP"),
            "VOLTage:LIMit:HIGH": (
                given(lambda text: channel.set_limit(text, high=True)),
                lambda: channel.high_limit_V,
            ),
            "VOLTage:LIMit:LOW": (
                given(lambda text: channel.set_limit(text, high=False)),
                lambda: channel.low_limit_V,
            ),
            "VOLTage:LIMit:STATe": (
                given(lambda text: channel.set_limited(boolean(text))),
                lambda: str(int(channel.limited)),
            ),
            "BURSt:STATe": (
                given(lambda text: channel.set_burst(boolean(text))),
                lambda: str(int(channel.burst)),
            ),
            "BURSt:MODE": (setting("mode", lambda text: choice(text, MODES)), lambda: channel.mode),
            "BURSt:NCYCles": (setting("cycles", cycles), lambda: channel.cycles),
        },
    )
    add(
        source,
        {
            "FREQuency": (
                given(lambda text: wave.set_period(1.0 / numeric(text, 1e-6, 30e6, 1e3))),
                lambda: 1.0 / wave.period_s,
            ),
            "FUNCtion:PULSe:PERiod": (
                given(lambda text: wave.set_period(numeric(text, *PERIODS_S, 1e-3))),
                lambda: wave.period_s,
            ),
            "FUNCtion:PULSe:WIDTh": (wave.set_width, lambda: wave.width_s),
            "FUNCtion:PULSe:HOLD": (wave.set_hold, lambda: wave.hold),
            "FUNCtion:ARBitrary": (wave.choose, lambda: f'"{wave.arb}"'),
            "FUNCtion:ARBitrary:SRATe": (wave.set_rate, lambda: wave.rate_per_s),
            "FUNCtion:ARBitrary:FILTer": (wave.set_filter, lambda: wave.filter),
            "DATA:ARBitrary": (wave.take, None),
            "DATA:ARBitrary:DAC": (lambda parameters: wave.take(parameters, counts=True), None),
            "DATA:VOLatile:CLEar": (lambda parameters: wave.clear(), None),
        },
    )
    for root in source:
        tree.add(f"{root}DATA:VOLatile:CATalog?", telling(wave.catalogue))
    add(
        trigger,
        {
            ":SOURce": (
                setting("source", lambda text: choice(text, SOURCES)),
                lambda: channel.source,
            ),
            ":SLOPe": (setting("slope", lambda text: choice(text, SLOPES)), lambda: channel.slope),
            ":DELay": (setting("delay_s", delay), lambda: channel.delay_s),
        },
    )
    add(
        output,
        {
            "[:STATe]": (
                given(lambda text: switch(channel, boolean(text))),
                lambda: str(int(channel.on)),
            ),
            ":LOAD": (given(lambda text: channel.set_load(load(text))), lambda: channel.load_ohm),
            ":POLarity": (
                setting("inverted", lambda text: choice(text, POLARITIES) == "INV"),
                lambda: "INV" if channel.inverted else "NORM",
            ),
        },
    )


def given(act: Callable[[str], None]) -> Act:
    """Return what hands on the only parameter of a command."""
    return lambda parameters: act(one(parameters))


def telling(tell: Tell) -> Callable[[list[str]], str]:
    """Return what answers a query without a parameter."""

    def handler(parameters: list[str]) -> str:
        none(parameters)
        return told(tell())

    return handler


def told(value: str | float) -> str:
    """Return a value as the instrument writes it."""
    return value if isinstance(value, str) else f"{value:+.13E}"


def only_vpp(text: str) -> None:
    """Take the unit of amplitudes; the others are not here."""
    choice(text, {"VPP": "VPP"})


def load(text: str) -> float:
    """Return a termination in ohm."""
    words = {"INF": OPEN, "INFINITY": OPEN, "MIN": LOADS_OHM[0], "MAX": LOADS_OHM[1]}
    words |= {"DEF": 50.0}
    return words[text.upper()] if text.upper() in words else numeric(text, *LOADS_OHM, 50.0)


def cycles(text: str) -> float:
    """Return the number of cycles of a burst."""
    endless = text.upper() in ("INF", "INFINITY")
    return OPEN if endless else float(round(numeric(text, 1, 1e8, 1)))


def delay(text: str) -> float:
    """Return the time from trigger to burst in s."""
    return numeric(text, 0.0, 1000.0, 0.0)
