"""Keysight 33522B waveform generator, SCPI over TCP: two channels, each at a coil of the world.

From the 33500 series guide and public client code: LF ends commands and replies, `+0,"No error"`
ends an error queue of 20, a trigger from the connector that both channels share, `*TRG` for
channels whose source is BUS. A value that is clipped is changed all the same, and the error says
so. Levels, termination and limits: see `Channel`; functions: see `Wave`. Its coils hang on drivers
of high impedance. Numbers are written as `+1.0000000000000E+00`, an open end as 9.9E+37. Assumed:
the error of an output whose protection has tripped, the byte order of blocks, and that modulation,
coupling and sums, which are not here, are refused as unknown.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, Protocol, runtime_checkable

from sim_instruments.faults.lasting import (
    LastingFault,
    LoadReset,
    NoTrigger,
    OutputTripped,
)
from sim_instruments.instrument import Setting
from sim_instruments.keysight.generator_33522b_channel import LOADS_OHM, OPEN, GeneratorChannel
from sim_instruments.keysight.generator_33522b_everyday import Everyday, SyncOutput
from sim_instruments.keysight.generator_33522b_wave import (
    FUNCTIONS,
    OWN_TEXTS,
    PERIODS_S,
    TRIPPED,
    Refusal,
    Wave,
)
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.wire.requests import without_blocks
from sim_instruments.wire.scpi import (
    TEXTS,
    ErrorQueue,
    ScpiError,
    boolean,
    choice,
    numeric,
)
from sim_instruments.wire.scpi_device import ScpiDevice
from sim_instruments.world.base import TriggerLine
from sim_instruments.world.serf_coils import VoltageHistory

SOURCES = {"IMM": "IMM", "IMMEDIATE": "IMM", "EXT": "EXT", "EXTERNAL": "EXT"}
SOURCES |= {"TIM": "TIM", "TIMER": "TIM", "BUS": "BUS"}
SLOPES = {"POS": "POS", "POSITIVE": "POS", "NEG": "NEG", "NEGATIVE": "NEG"}
MODES = {"TRIG": "TRIG", "TRIGGERED": "TRIG", "GAT": "GAT", "GATED": "GAT"}
POLARITIES = {"NORM": "NORM", "NORMAL": "NORM", "INV": "INV", "INVERTED": "INV"}


def shown(give: Callable[[], str | float]) -> str:
    """Return a value as the instrument writes it."""
    value = give()
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


FIRMWARE = "4.00-1.19-2.00-52-00"
COILS = ("x", "y", "z", "gradient", "none")


@runtime_checkable
class CoilWorld(Protocol):
    """A world with coils that a voltage drives."""

    def drive(self, coil: str, history: VoltageHistory) -> None:
        """Have a coil driven by a voltage, now and in all time."""


class WordedErrors(ErrorQueue):
    """An error queue whose entries say more than their number does; `empty` when there is none."""

    def __init__(self, depth: int, empty: str) -> None:
        super().__init__(depth)
        self._empty = f'+0,"{empty}"'
        self._entries: deque[Any] = deque()

    def push(self, code: int, more: str = "") -> None:
        """Append an error; `more` follows its standard text."""
        if len(self._entries) < self._depth:
            text = OWN_TEXTS.get(code) or TEXTS[code]
            self._entries.append(f'{code:+d},"{text}{";" if more else ""}{more}"')
        else:
            self._entries[-1] = f'-350,"{TEXTS[-350]}"'

    def pop(self) -> str:
        """Return and remove the oldest error."""
        return str(self._entries.popleft()) if self._entries else self._empty


class Keysight33522B(ScpiDevice):
    """The generator, in whatever simulated world has coils to drive and a `trigger`.

    Truth (`simulator` mapping): by channel, 1 and 2, `coils` (x, y, z, gradient or none),
    `gain_error` and `offset` (V, at an open end, while the output is on); `trigger_latency`, from
    the edge to the output (105 ns). May be given: `maker`, Keysight or Agilent Technologies;
    `empty_queue`, the words of an empty error queue.
    """

    model = "Keysight 33522B"
    longest_line = 1 << 24
    takes_blocks = True

    lasting_faults: ClassVar = (NoTrigger.kind, OutputTripped.kind, LoadReset.kind)

    def __init__(self, setting: Setting) -> None:
        truth = setting.truth
        maker = truth.text("maker", "Keysight Technologies")
        super().__init__(f"{maker},33522B,{setting.serial},{FIRMWARE}")
        empty = truth.text("empty_queue", "No error")
        self.errors: WordedErrors = WordedErrors(self.error_queue_depth, empty)
        self.tree.add("SYSTem:ERRor[:NEXT]?", self._answer(self.errors.pop))
        self.tree.add("SYSTem:ERRor:ALL?", self._answer(self.errors.pop_all))
        self._clock, self._faults = setting.clock, setting.faults
        self._blocks: list[bytes] = []
        self._sync = SyncOutput()
        self._everyday: dict[int, Everyday] = {}
        self._latency_s = truth.quantity("trigger_latency", "s")
        coils, gains, offsets = (truth.section(key) for key in ("coils", "gain_error", "offset"))
        driven, wire = setting.world.find(CoilWorld), setting.world.find(TriggerLine)
        self._channels: dict[int, GeneratorChannel] = {}
        for number in (1, 2):
            # JSON has no numbers for keys.
            key: Any = number if number in coils else str(number)
            coil = coil_name(coils, key)
            history = VoltageHistory()
            self._channels[number] = GeneratorChannel(
                history, gains.quantity(key, "1"), offsets.quantity(key, "V"), self._complain
            )
            if driven is not None and coil != "none":
                driven.drive(coil, history)
            self._add_channel(number, self._channels[number])
        if wire is not None:
            wire.listen(lambda time_s: self._edge(time_s, "POS"), self._fall)
        self.tree.add("*TRG", self._do(self._bus_trigger))
        self.tree.add("SYSTem:BEEPer[:IMMediate]", self._do(lambda: None))
        self._faults.when_changed(OutputTripped.kind, self._trip)
        self._faults.when_changed(LoadReset.kind, self._reset_loads)
        self.begin_to_serve(setting)

    def _add_channel(self, number: int, channel: GeneratorChannel) -> None:
        """Add the commands of a channel; after each its coil has what the settings say."""
        wave = channel.wave
        held: dict[str, dict[str, tuple[Callable[[str], None], Callable[[], str | float]]]] = {
            "SOURce": {
                "FUNCtion": (
                    lambda text: channel.set_function(choice(text, FUNCTIONS)),
                    lambda: wave.function,
                ),
                "VOLTage": (channel.set_amplitude, lambda: channel.amplitude_V),
                "VOLTage:OFFSet": (channel.set_offset, lambda: channel.offset_V),
                "VOLTage:HIGH": (channel.set_high, lambda: channel.high_V),
                "VOLTage:LOW": (channel.set_low, lambda: channel.low_V),
                "VOLTage:UNIT": (only_vpp, lambda: "VPP"),
                "VOLTage:LIMit:HIGH": (
                    partial(channel.set_limit, high=True),
                    lambda: channel.high_limit_V,
                ),
                "VOLTage:LIMit:LOW": (
                    partial(channel.set_limit, high=False),
                    lambda: channel.low_limit_V,
                ),
                "VOLTage:LIMit:STATe": (
                    lambda text: channel.set_limited(boolean(text)),
                    lambda: str(int(channel.limited)),
                ),
                "BURSt:STATe": (
                    lambda text: channel.set_burst(boolean(text)),
                    lambda: str(int(channel.burst)),
                ),
                "BURSt:MODE": (
                    lambda text: setattr(channel, "mode", choice(text, MODES)),
                    lambda: channel.mode,
                ),
                "BURSt:NCYCles": (
                    lambda text: setattr(channel, "cycles", cycles(text)),
                    lambda: channel.cycles,
                ),
                "FREQuency": (
                    lambda text: wave.set_period(1.0 / numeric(text, 1e-6, 30e6, 1e3)),
                    lambda: 1.0 / wave.period_s,
                ),
                "FUNCtion:PULSe:PERiod": (
                    lambda text: wave.set_period(numeric(text, *PERIODS_S, 1e-3)),
                    lambda: wave.period_s,
                ),
                "FUNCtion:PULSe:WIDTh": (wave.set_width, lambda: wave.width_s),
                "FUNCtion:PULSe:HOLD": (wave.set_hold, lambda: wave.hold),
                "FUNCtion:ARBitrary": (wave.choose, lambda: f'"{wave.arb}"'),
                "FUNCtion:ARBitrary:SRATe": (wave.set_rate, lambda: wave.rate_per_s),
                "FUNCtion:ARBitrary:FILTer": (wave.set_filter, lambda: wave.filter),
            },
            "TRIGger": {
                "SOURce": (
                    lambda text: setattr(channel, "source", choice(text, SOURCES)),
                    lambda: channel.source,
                ),
                "SLOPe": (
                    lambda text: setattr(channel, "slope", choice(text, SLOPES)),
                    lambda: channel.slope,
                ),
                "DELay": (
                    lambda text: setattr(channel, "delay_s", numeric(text, 0.0, 1000.0, 0.0)),
                    lambda: channel.delay_s,
                ),
            },
            "OUTPut": {
                "[:STATe]": (
                    lambda text: self._switch(channel, boolean(text)),
                    lambda: str(int(channel.on)),
                ),
                "LOAD": (lambda text: channel.set_load(load(text)), lambda: channel.load_ohm),
                "POLarity": (
                    lambda text: setattr(channel, "inverted", choice(text, POLARITIES) == "INV"),
                    lambda: "INV" if channel.inverted else "NORM",
                ),
            },
        }
        everyday = self._everyday[number] = Everyday(channel)
        held["SOURce"] |= everyday.source()
        held["OUTPut"] |= self._sync.of(number) | (self._sync.common() if number == 1 else {})
        acts: dict[str, Callable[[list[str]], None]] = {
            "DATA:ARBitrary": partial(self._take_points, wave, counts=False),
            "DATA:ARBitrary:DAC": partial(self._take_points, wave, counts=True),
            "DATA:VOLatile:CLEar": lambda _: wave.clear(),
        }

        def applied(act: Callable[[Any], None], given: Any) -> None:
            act(given)
            channel.apply(self._clock.now())

        # The number of the first channel may be left out, and so may SOURce.
        first = number == 1
        for name, table in held.items():
            roots = [f"{name}{number}", *([name] if first else [])]
            for header, (take, give) in table.items():
                joined = header if header.startswith("[") else f":{header}"
                values = {joined: (partial(applied, take), partial(shown, give))}
                self.add_settings(values, *roots)
                if first and name == "SOURce":
                    self.add_settings(values)
        for root in (f"SOURce{number}:", *(("SOURce:", "") if first else ())):
            for header, act in acts.items():
                self.tree.add(root + header, partial(applied, act))
            self.add_settings({f"{root}DATA:VOLatile:CATalog": (None, wave.catalogue)})
        everyday.add_to(
            self.tree,
            [f"SOURce{number}:", *(("SOURce:", "") if first else ())],
            lambda: channel.apply(self._clock.now()),
        )

    def energised(self) -> bool:
        """Return whether an output is on."""
        return any(channel.on for channel in self._channels.values())

    def questionable_condition(self) -> int:
        """Return 1 while an output's protection is tripped."""
        return int(self._faults.now(OutputTripped.kind) is not None)

    def reset(self) -> None:
        """Go to sines of 100 mVpp into 50 ohm, both outputs off."""
        self._sync.reset()
        for number, channel in self._channels.items():
            self._everyday[number].reset()
            channel.reset()
            channel.apply(self._clock.now())

    def _line(self, line: bytes) -> bytes:
        # The parser splits at characters that a block may hold: in its place stands its number.
        text, self._blocks = without_blocks(line)
        return super()._line(text)

    def _take_points(self, wave: Wave, parameters: list[str], *, counts: bool) -> None:
        block = None
        if len(parameters) == 2 and parameters[1].startswith("#") and self._blocks:
            block = self._blocks[int(parameters[1][1:])]
        wave.take(parameters, counts=counts, block=block)

    def _complain(self, code: int, more: str) -> None:
        self._standard_event |= 16
        self.errors.push(code, more)

    def _switch(self, channel: GeneratorChannel, on: bool) -> None:
        if on and self._faults.now(OutputTripped.kind) is not None:
            raise Refusal(TRIPPED)
        channel.on = on

    def _bus_trigger(self) -> None:
        waiting = [c for c in self._channels.values() if c.waits and c.source == "BUS"]
        if not waiting:
            raise ScpiError(-211)
        for channel in waiting:
            channel.trigger(self._clock.now(), self._latency_s)

    def _fall(self, time_s: float) -> None:
        self._edge(time_s, "NEG")

    def _edge(self, time_s: float, slope: str) -> None:
        if self._faults.now(NoTrigger.kind) is not None:
            return
        for channel in self._channels.values():
            if channel.source == "EXT" and channel.slope == slope:
                channel.trigger(time_s, self._latency_s)

    def _trip(self, time_s: float, fault: LastingFault | None) -> None:
        if fault is not None:
            for channel in self._channels.values():
                channel.on = False
                channel.apply(time_s)
            self.errors.push(TRIPPED)

    def _reset_loads(self, time_s: float, fault: LastingFault | None) -> None:
        if fault is not None:
            for channel in self._channels.values():
                channel.limited = False
                channel.set_load(50.0)


def coil_name(coils: Truth, key: Any) -> str:
    """Return the coil of a channel; SimulationError for one that no world has."""
    name = coils.text(key)
    if name not in COILS:
        raise SimulationError(f"{coils.where}.{key}: one of {', '.join(COILS)} was expected")
    return name
