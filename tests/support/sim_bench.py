"""The bench that the tests of the simulated instruments run on, and how they reach it."""

from __future__ import annotations

import copy
import socket
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from threading import Event, Thread
from typing import Any, Self

import cantools
import numpy as np

from sim_instruments.bench import Maker, SimulatedBench
from sim_instruments.generic.can_pulse_board import CanPulseBoard
from sim_instruments.kepco.bop import KepcoBop
from sim_instruments.lakeshore.gaussmeter_f71 import LakeshoreF71
from station.clock import Clock, VirtualClock
from station.instruments.opening import InstrumentPlace
from station.safety.readings import Readings

SIMULATORS: dict[str, Maker] = {
    "kepco-bop-36-12": KepcoBop,
    "lakeshore-f71": LakeshoreF71,
    "can-pulse-board": CanPulseBoard,
}


def coil(radius: str, *, leans: dict[str, str]) -> dict[str, Any]:
    return {
        "radius": radius,
        "turns": 100,
        "spacing_error": "0.3 %",
        "normal": leans,
        "resistance": "1.2 ohm",
        "inductance": "18 mH",
    }


def supply(axis: str, serial: str) -> dict[str, Any]:
    return {
        "driver": "kepco-bop-36-12",
        "serial": serial,
        "simulator": {
            "coil": axis,
            "gain_error": "0.05 %",
            "offset": "0.3 mA",
            "converter_error": "20 ppm",
            "readback_gain_error": "-0.03 %",
            "readback_offset": "-0.5 mA",
            "readback_noise": "0.2 mA",
            "time_base_error": "50 ppm",
        },
    }


BENCH: dict[str, Any] = {
    "name": "simulated",
    "simulation": {
        "seed": 1,
        "coils": {
            "x": coil("300 mm", leans={"towards_y": "0.4 deg", "towards_z": "-0.3 deg"}),
            "y": coil("270 mm", leans={"towards_x": "-0.2 deg", "towards_z": "0.5 deg"}),
            "z": coil("240 mm", leans={"towards_x": "0.3 deg", "towards_y": "0.2 deg"}),
        },
        "ambient_field": {"x": "0.021 mT", "y": "-0.004 mT", "z": "-0.043 mT"},
        "probe_position": {"x": "20 mm", "y": "-15 mm", "z": "30 mm"},
        "gyro": {
            "channel": 1,
            "mounting_error": {
                "about_x": "0.05 deg",
                "about_y": "-0.04 deg",
                "about_z": "0.06 deg",
            },
            "latitude": "26.9 deg",
            "input_axis": {"azimuth": "40 deg", "elevation": "0 deg"},
            "bias": "0.006 deg/h",
            "angle_random_walk": "0.001 deg/sqrt(h)",
            "rate_random_walk_in_one_hour": "0.003 deg/h",
            "dither_residual": "0.2 arcsec",
            "pulse_weight": "0.3 arcsec",
            "warm_up": {
                "amplitude": "0.15 deg/h",
                "time_constant": "12 min",
                "ambient_temperature": "22 degC",
                "temperature_rise": "9 K",
            },
            "magnetic_sensitivity": {
                "IA": "0.045 deg/h/mT",
                "NA": "-0.018 deg/h/mT",
                "LA": "0.026 deg/h/mT",
            },
            "quadratic_sensitivity_per_mT": {
                "IA": "0.002 deg/h/mT",
                "NA": "0.001 deg/h/mT",
                "LA": "-0.001 deg/h/mT",
            },
        },
    },
    "instruments": {
        "coil_supply.x": supply("x", "H148201"),
        "coil_supply.y": supply("y", "H148202"),
        "coil_supply.z": supply("z", "H148203"),
        "gaussmeter": {
            "driver": "lakeshore-f71",
            "serial": "LSA2B7X",
            "simulator": {
                "noise_per_sample": "0.4 uT",
                "gain_error": {"x": "0.11 %", "y": "-0.08 %", "z": "0.05 %"},
                "zero_offset": {"x": "1.2 uT", "y": "-0.8 uT", "z": "0.5 uT"},
                "rotation": {"about_x": "0.08 deg", "about_y": "-0.05 deg", "about_z": "0.1 deg"},
                "clock_offset": "0.37 s",
                "clock_error": "12 ppm",
                "probe_temperature": "23.4 degC",
            },
        },
        "gyro_acquisition": {
            "driver": "can-pulse-board",
            "serial": "1042",
            "simulator": {"channel": "can0", "clock_error": "-8 ppm"},
        },
        "dut_power": {"driver": "operator-power", "serial": "none"},
    },
}


def bench_with(**simulation: Any) -> dict[str, Any]:
    """Return a copy of the bench with other values below `simulation`; `gyro__bias` nests."""
    bench = copy.deepcopy(BENCH)
    for path, value in simulation.items():
        *sections, key = path.split("__")
        place = bench["simulation"]
        for section in sections:
            place = place[section]
        place[key] = value
    return bench


@contextmanager
def served(
    clock: Clock,
    bench: Mapping[str, Any] = BENCH,
    procedure: str = "rlg-magnetic-sensitivity",
    simulators: Mapping[str, Maker] | None = SIMULATORS,
) -> Iterator[SimulatedBench]:
    """Serve a bench while this thread takes part in time."""
    with clock.participant("test"):
        simulation = SimulatedBench(bench, clock, procedure, simulators)
        try:
            yield simulation
        finally:
            simulation.close()
            clock.stop()


class ServedInstrument:
    """One instrument of a served bench, and what a test needs of it."""

    def __init__(self, clock: Clock, simulation: SimulatedBench, name: str, maker: Any) -> None:
        self.clock, self.simulation, self.name, self.maker = clock, simulation, name, maker
        self.readings = Readings(clock)
        self.heard: list[tuple[str, bytes]] = []
        self.address = str(simulation.instruments[name]["address"])

    @property
    def served(self) -> Any:
        """The simulated instrument itself."""
        return self.simulation._served[self.name]

    def opened(self, limits: Mapping[str, float], **settings: Any) -> Any:
        """Return the driver, opened."""
        return self.maker(
            InstrumentPlace(
                self.name,
                self.address,
                self.clock,
                settings,
                limits,
                trace=lambda direction, data: self.heard.append((direction, data)),
                publisher=self.readings.publisher(self.name),
            )
        )

    def wait(self, driver: Any, *axis: int, within_s: float = 1000.0) -> None:
        """Wait until it, or an axis of it, stands still."""
        until_s = self.clock.now() + within_s
        while driver.is_moving(*axis):
            assert self.clock.now() < until_s
            self.clock.sleep(0.05)


class Client:
    """A raw TCP client of one instrument, which is told of in `entry`."""

    def __init__(self, entry: Mapping[str, Any], clock: Clock) -> None:
        self._socket = socket.create_connection((entry["host"], entry["port"]))
        self._clock = clock
        self._wire = clock.wire(f"{entry['host']}:{entry['port']}")
        self._wire.open()

    def close(self) -> None:
        """Leave."""
        self._wire.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Line(Client):
    """A raw TCP client of one instrument that speaks in lines."""

    def __init__(self, simulation: SimulatedBench, name: str, clock: Clock) -> None:
        super().__init__(simulation.instruments[name], clock)

    def write(self, text: str) -> None:
        """Send one message that has no reply, and give the instrument a millisecond for it."""
        self._send(text.encode("ascii") + b"\n")
        self._clock.sleep(1e-3)

    def ask(self, text: str) -> str:
        """Send one message and return the reply without its terminator."""
        self._send(text.encode("ascii") + b"\n")
        assert self._wire.wait(self._clock.now() + 5.0), f"no reply to {text}"
        reply = b""
        while not reply.endswith(b"\n"):
            reply += self._socket.recv(65536)
        self._wire.received()
        return reply.decode("ascii").rstrip("\r\n")

    def raw_ask(self, data: bytes) -> bytes:
        """Send bytes as they are and return the raw reply."""
        self._send(data)
        assert self._wire.wait(self._clock.now() + 5.0)
        reply = self._socket.recv(65536)
        self._wire.received()
        return reply

    def _send(self, data: bytes) -> None:
        self._wire.sent(len(data))
        self._socket.sendall(data)


class Frames(Client):
    """A raw socketcand client; its reader thread keeps every frame as (id, time, data)."""

    def __init__(self, simulation: SimulatedBench, clock: Clock, mode: str = "< rawmode >") -> None:
        entry = simulation.instruments["gyro_acquisition"]
        super().__init__(entry, clock)
        assert self._socket.recv(256) == b"< hi >"
        for command in (f"< open {entry['channel']} >", mode):
            self._socket.sendall(command.encode("ascii"))
            assert self._socket.recv(256) == b"< ok >"
        self.received: list[tuple[int, float, bytes]] = []
        self._echoed = Event()
        self._thread = Thread(target=self._read, daemon=True)
        self._thread.start()

    def command(
        self, command: int, mask: int = 0, interval_ms: float = 0.0, ticket: int = 7
    ) -> int:
        """Send a command and return the result in its acknowledgement."""
        data = struct.pack("<BBIH", command, mask, round(interval_ms * 10), ticket)
        before = len(self.of(0x101))
        self.send(0x100, data)
        for _ in range(3000):
            self._clock.sleep(1e-3)
            acknowledgements = self.of(0x101)
            if len(acknowledgements) > before:
                return acknowledgements[-1][1]
        raise AssertionError(f"no acknowledgement of command {command}")

    def send(self, identifier: int, data: bytes) -> None:
        """Send one frame."""
        text = f"< send {identifier:03X} {len(data):X} {' '.join(f'{b:x}' for b in data)} >"
        self._wire.sent(1)
        self._socket.sendall(text.encode("ascii"))

    def says(self, text: str) -> None:
        """Send what has no answer, and wait until it is done."""
        self._echoed.clear()
        self._socket.sendall(f"{text}< echo >".encode("ascii"))
        assert self._echoed.wait(5.0)

    def of(self, identifier: int) -> list[bytes]:
        """Return the data of all frames with this identifier so far."""
        return [data for number, _, data in self.received if number == identifier]

    def _read(self) -> None:
        pending = ""
        with suppress(OSError):
            while chunk := self._socket.recv(65536):
                *frames, pending = (pending + chunk.decode("ascii")).split(">")
                came = [frame.split() for frame in frames]
                for _, kind, *rest in came:
                    if kind == "echo":
                        self._echoed.set()
                        continue
                    assert kind == "frame"
                    number, time_s, *data = rest
                    row = int(number, 16), float(time_s), bytes.fromhex("".join(data))
                    self.received.append(row)
                self._wire.picked_up(sum(kind == "frame" for _, kind, *_ in came))

    def close(self) -> None:
        """Leave."""
        self._wire.close()
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._thread.join(5)


def decoder(bench: SimulatedBench) -> Any:
    """Return the message file of the pulse board, read by cantools."""
    return cantools.database.load_file(bench.instruments["gyro_acquisition"]["dbc"])


def counts(board: Frames, bench: SimulatedBench) -> np.ndarray:
    """Return sequence, counts and temperature of every frame of channel 1, one row each."""
    database = decoder(bench)
    decoded = [database.decode_message(0x121, data) for data in board.of(0x121)]
    return np.array([[one["sequence"], one["counts"], one["temperature"]] for one in decoded])


SUPPLY, GAUSSMETER, BOARD = "coil_supply.y", "gaussmeter", "gyro_acquisition"
START, STOP = 1, 2
Entry = dict[str, Any]


@contextmanager
def faulty(*entries: Entry) -> Iterator[tuple[VirtualClock, SimulatedBench]]:
    clock = VirtualClock()
    with served(clock, bench_with(faults=list(entries))) as bench:
        yield clock, bench


@contextmanager
def line_with(instrument: str, **entry: Any) -> Iterator[tuple[RawLine, SimulatedBench]]:
    with (
        faulty({"instrument": instrument, **entry}) as (clock, bench),
        RawLine(bench, instrument, clock) as line,
    ):
        yield line, bench


@contextmanager
def board_with(**entry: Any) -> Iterator[tuple[VirtualClock, SimulatedBench, Frames]]:
    with faulty({"instrument": BOARD, **entry}) as (clock, bench):
        bench.act("dut-power-on")
        with Frames(bench, clock) as board:
            yield clock, bench, board


class RawLine(Line):
    """A client that also sees what is no proper reply."""

    def bytes_of(self, text: str, within_s: float = 1.0) -> bytes | None:
        """Return what comes back within a time, as it is; None for nothing at all."""
        self._send(text.encode("ascii") + b"\n")
        return self.what_comes(within_s)

    def what_comes(self, within_s: float = 1.0) -> bytes | None:
        """Return what comes back within a time; empty when the connection has ended."""
        if not self._wire.wait(self._clock.now() + within_s):
            return None
        self._wire.received()
        return self._socket.recv(65536)
