"""A small world with a navigator that turns as it is told, and the two drivers of it."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from contextlib import AbstractContextManager, suppress
from threading import Thread
from typing import Any

import numpy as np
from fixture import Fixture, opened
from our_drivers import bench_data

from drivers.generic.can_navigator import CanNavigator
from drivers.generic.serial_navigator import SerialNavigator
from sim_instruments.generic.can_navigator import CanNavigator as SimulatedOnCan
from sim_instruments.generic.serial_navigator import SerialNavigator as SimulatedOnSerial
from sim_instruments.world.base import Room

NAME = "navigator"
KINDS = ("can", "serial")
TRUTH = {"resolution": "0.0001 deg", "latency": "30 ms", "clock_error": "200 ppm"}
STRETCH = 1 + 200e-6
LATENCY_S = 0.03
RESOLUTION_DEG = 1e-4


class Plate(Room):
    """A plate that turns at a steady rate under a navigator that aligns within 100 s."""

    def __init__(self, rate_deg_per_s: float = 7.0, *, powered: bool = True) -> None:
        super().__init__()
        self.dut_powered = powered
        self.rate_deg_per_s = rate_deg_per_s
        self.latitudes: list[float] = []
        self.asked_until_s = 0.0
        self._aligned_from_s = np.inf

    def power(self, on: bool) -> None:
        self.dut_powered = on
        self._aligned_from_s = np.inf
        self.version += 1

    def turn(self, rate_deg_per_s: float) -> None:
        self.rate_deg_per_s = rate_deg_per_s
        self.version += 1

    def align(self, time_s: float, latitude_deg: float) -> None:
        self.latitudes.append(latitude_deg)
        self._aligned_from_s = time_s + 100.0
        self.version += 1

    def aligned(self, time_s: float) -> bool:
        return bool(time_s >= self._aligned_from_s)

    def navigator_attitude(self, times_s: np.ndarray) -> np.ndarray:
        heading = (self.rate_deg_per_s * times_s) % 360.0
        return np.stack((heading, -0.01 * times_s - 89.0 * 0.5, 0.02 * times_s - 170.0), axis=1)

    def gyro_temperature_degC(self, times_s: np.ndarray) -> np.ndarray:
        return np.stack((-40.0 + 0.01 * times_s, 20.0 + 0.0 * times_s, -0.5 * times_s), axis=1)


def navigator(
    kind: str, *faults: Mapping[str, Any], room: Any = None, **truth: Any
) -> AbstractContextManager[tuple[Fixture, Any]]:
    """Serve a navigator of a kind and open its driver."""
    simulator: Any = SimulatedOnCan if kind == "can" else SimulatedOnSerial
    driver: Any = CanNavigator if kind == "can" else SerialNavigator
    given = {**TRUTH, **({"channel": "can0"} if kind == "can" else {}), **truth}
    return opened(NAME, simulator, driver, given, room or Plate(), *faults)


class RawLine:
    """A client of the serial line that sends and keeps bytes."""

    def __init__(self, fixture: Fixture) -> None:
        entry = fixture.instruments[fixture.name]
        self._clock = fixture.clock
        self._wire = fixture.clock.wire(f"{entry['host']}:{entry['port']}")
        self._socket = socket.create_connection((entry["host"], entry["port"]))
        self._wire.open()
        self.received = b""
        self._thread = Thread(target=self._read, daemon=True)
        self._thread.start()

    def send(self, data: bytes) -> list[tuple[int, bytes]]:
        """Send bytes and return the frames that came within a tenth of a second."""
        self.write(data)
        return raw_frames(self.received)

    def write(self, data: bytes) -> None:
        """Send bytes and keep what comes within a tenth of a second, and after."""
        self.received = b""
        self._wire.sent(len(data))
        self._socket.sendall(data)
        self._clock.sleep(0.1)

    def close(self) -> None:
        self._wire.close()
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._thread.join(5)

    def _read(self) -> None:
        with suppress(OSError):
            while data := self._socket.recv(65536):
                self.received += data
                self._wire.picked_up(len(data))


def raw_frame(kind: int, payload: bytes) -> bytes:
    """Return a frame of the serial line, written by its layout alone."""
    data = bytes([0x9A, 0x65, kind, len(payload)]) + payload
    return data + bitwise_crc(data).to_bytes(4, "big")


def raw_frames(data: bytes) -> list[tuple[int, bytes]]:
    """Return kind and payload of each frame on the serial line, read by its layout alone."""
    frames = []
    while data:
        assert data[:2] == bytes.fromhex("9A65")
        length = data[3]
        whole, crc, data = data[: 4 + length], data[4 + length : 8 + length], data[8 + length :]
        assert bitwise_crc(whole) == int.from_bytes(crc, "big")
        frames.append((whole[2], whole[4:]))
    return frames


def bitwise_crc(data: bytes) -> int:
    """Return the checksum of STIM300, bit by bit as its data sheet describes it."""
    crc = 0xFFFFFFFF
    for byte in data + bytes(-len(data) % 4):
        for bit in range(7, -1, -1):
            feedback = (crc >> 31) ^ (byte >> bit & 1)
            crc = (crc << 1) & 0xFFFFFFFF
            if feedback:
                crc ^= 0x04C11DB7
    return crc


def bench_of(kind: str) -> dict[str, Any]:
    """Return the shipped bench with a navigator of a kind, and nothing else."""
    return bench_data(f"{kind}-navigator")
