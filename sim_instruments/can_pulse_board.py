"""The laser-gyro pulse board on CAN, as `config/dbc/pulse_board.dbc` describes it.

The frames are packed here by hand, not by a DBC library, so that the message file is checked
against an independent reading of it.
"""

from __future__ import annotations

import struct
from importlib.resources import files
from typing import Any, ClassVar

import numpy as np

from sim_instruments.faults.lasting import Dark, Frozen, LastingFault, Overheating, Silent
from sim_instruments.instrument import Setting
from sim_instruments.pulse_sampler import NO_SENSOR, OpenInputs, PulseSampler
from sim_instruments.socketcand import SocketcandServer, frame_text
from sim_instruments.tcp import HOST
from sim_instruments.truth import SimulationError
from sim_instruments.world.laser_gyro_bench import LaserGyroBench

COMMAND, ACK, STATUS, IDENTITY, FIRST_COUNTS = 0x100, 0x101, 0x110, 0x111, 0x121
START, STOP, IDENTIFY, REPORT_STATUS = 1, 2, 3, 4
OK, UNKNOWN_COMMAND, BAD_INTERVAL, BAD_MASK, ALREADY_RUNNING, BAD_LENGTH = range(6)
REFUSED_BIT, OVERFLOW_BIT = 1, 2
CHANNELS = 3
FIRMWARE_MAJOR, FIRMWARE_MINOR, HARDWARE_REVISION, PROTOCOL_VERSION = 1, 2, 1, 1
SHORTEST, LONGEST = 10, 100_000  # sample interval in units of 0.1 ms
STATUS_PERIOD_S = 1.0
SHORTEST_BATCH_S = 0.1
SEQUENCE_DIGITS = 4


class CanPulseBoard:
    """The board, with the gyro of the simulated world on one of its channels where it has one.

    Truth (`simulator` mapping): `channel` of the bus, `clock_error` of the board's clock: by how
    much its intervals are too long.
    """

    lasting_faults: ClassVar = (Frozen.kind, Silent.kind, Dark.kind, Overheating.kind)

    def __init__(self, setting: Setting) -> None:
        truth = setting.truth
        self._name, self._clock, self._rng = setting.name, setting.clock, setting.rng
        self._world = setting.world
        if not setting.serial.isdigit() or int(setting.serial) >= 2**32:
            raise SimulationError(
                f"{truth.where}: the pulse board's serial number is a number below 2^32, "
                f"got '{setting.serial}'"
            )
        self._serial = int(setting.serial)
        self._stretch = 1.0 + truth.quantity("clock_error", "1")
        self._gyro_bench = self._world if isinstance(self._world, LaserGyroBench) else None
        self._gyro_bit = 1 << (self._gyro_bench.gyro.channel - 1) if self._gyro_bench else 0
        if self._gyro_bit >= 1 << CHANNELS:
            raise SimulationError("simulation.gyro.channel: the pulse board has channels 1 to 3")
        self._sampler = (
            PulseSampler(self._gyro_bench, self._rng) if self._gyro_bench else OpenInputs()
        )
        self._acquisition = 0
        self._running = False
        self._mask = 0
        self._interval = 0
        self._samples = 0
        self._error_bits = 0
        self._closed = False
        self._faults = setting.faults
        self._faults.when_changed(Dark.kind, self._darken)
        self._faults.when_changed(Overheating.kind, self._overheat)
        self._last_shown = bytes(8).hex()
        self._server = SocketcandServer(
            setting.name,
            setting.port,
            truth.text("channel"),
            setting.clock,
            self._world.lock,
            self._received,
            self._someone_listens,
            setting.faults,
        )
        self._reporting = False
        self._server.begin()

    def describe(self) -> dict[str, Any]:
        """Return what `station sim` prints about this instrument."""
        port, channel = self._server.port, self._server.channel
        return {
            "model": "CAN pulse board",
            "protocol": "socketcand",
            "address": f"socketcand://{HOST}:{port}/{channel}",
            "host": HOST,
            "port": port,
            "channel": channel,
            "dbc": str(files("config") / "dbc" / "pulse_board.dbc"),
        }

    def close(self) -> None:
        """Stop serving; the board's threads end when they next look."""
        self._closed = True
        self._running = False
        self._server.close()

    def _received(self, identifier: int, data: bytes) -> None:
        if identifier != COMMAND:
            return
        if len(data) != 8:
            self._refuse_or_accept(data[0] if data else 0, BAD_LENGTH, 0)
            return
        command, mask, interval, request = struct.unpack("<BBIH", data)
        if command == START:
            result = self._start(mask, interval)
        elif command == STOP:
            self._running = False
            result = OK
        else:
            result = OK if command in (IDENTIFY, REPORT_STATUS) else UNKNOWN_COMMAND
        self._refuse_or_accept(command, result, request)
        if command == IDENTIFY:
            versions = (FIRMWARE_MAJOR, FIRMWARE_MINOR, HARDWARE_REVISION, CHANNELS)
            self._send(IDENTITY, struct.pack("<I4B", self._serial, *versions))
        elif command == REPORT_STATUS:
            self._send_status()

    def _refuse_or_accept(self, command: int, result: int, request: int) -> None:
        if result != OK:
            self._error_bits |= REFUSED_BIT
        self._send(ACK, struct.pack("<BBHI", command, result, request, self._interval))

    def _start(self, mask: int, interval: int) -> int:
        if self._running:
            return ALREADY_RUNNING
        if not SHORTEST <= interval <= LONGEST:
            return BAD_INTERVAL
        if not 0 < mask < 1 << CHANNELS:
            return BAD_MASK
        self._mask, self._interval = mask, interval
        self._samples, self._error_bits = 0, 0
        self._acquisition += 1
        self._running = True
        number = self._acquisition
        self._sampler.begin(self._clock.now(), interval * 1e-4 * self._stretch)
        # The first acquisition has the device's own name, for the order among equal times.
        name = self._name if number == 1 else f"{self._name} {number}"
        self._clock.start(name, lambda: self._acquire(number))
        return OK

    def _acquire(self, number: int) -> None:
        """Send the frames of one acquisition, in batches of at least 0.1 s."""
        batch = max(1, int(np.ceil(SHORTEST_BATCH_S / self._sampler.interval_s - 1e-3)))
        while True:
            due_s = self._sampler.time_s(self._samples + batch)
            while due_s - self._clock.now() > 1.0:
                # Long intervals are slept through in pieces, to notice an end.
                self._clock.sleep(1.0)
                if self._over(number):
                    return
            self._clock.sleep_until(due_s)
            with self._world.lock:
                if self._over(number):
                    return
                self._faults.catch_up()
                text, frames = self._batch(batch)
            self._server.send_frames(text, frames)

    def _over(self, number: int) -> bool:
        return self._closed or not self._running or number != self._acquisition

    def _batch(self, count: int) -> tuple[str, int]:
        first = self._samples + 1
        self._samples += count
        gyro_hex = self._sampler.frames_hex(count)
        if self._sampler.overflowed:
            self._error_bits |= OVERFLOW_BIT
        numbers = range(first, first + count)
        gyro_hex, sent = self._as_faults_say(numbers, gyro_hex)
        parts = []
        channels = [k for k in range(CHANNELS) if self._mask >> k & 1]
        for n, data, goes in zip(numbers, gyro_hex, sent, strict=True):
            if not goes:
                continue
            time_s = self._sampler.time_s(n)
            for k in channels:
                if self._gyro_bit >> k & 1:
                    shown = data
                else:
                    shown = struct.pack("<Hih", n & 0xFFFF, 0, NO_SENSOR).hex()
                parts.append(frame_text(FIRST_COUNTS + k, time_s, shown))
        return "".join(parts), len(parts)

    def _as_faults_say(self, numbers: range, frames: list[str]) -> tuple[list[str], list[bool]]:
        """Return the frames of samples, frozen where they are, and which of them are sent."""
        if not self._faults.all:
            self._last_shown = frames[-1]
            return frames, [True] * len(frames)
        times = np.array([self._sampler.time_s(n) for n in numbers])
        shown = list(frames)
        for k in np.flatnonzero(self._faults.during(Frozen.kind, times)).tolist():
            last = shown[k - 1] if k else self._last_shown
            shown[k] = frames[k][:SEQUENCE_DIGITS] + last[SEQUENCE_DIGITS:]
        self._last_shown = shown[-1]
        return shown, (~self._faults.during(Silent.kind, times)).tolist()

    def _darken(self, time_s: float, fault: LastingFault | None) -> None:
        if self._gyro_bench is not None:
            self._gyro_bench.darken_gyro(time_s, fault is not None)

    def _overheat(self, time_s: float, fault: LastingFault | None) -> None:
        if self._gyro_bench is not None:
            rise_K = fault.rise_K if isinstance(fault, Overheating) else 0.0
            self._gyro_bench.overheat_gyro(time_s, rise_K)

    def _someone_listens(self) -> None:
        # Not before: with a thread asleep and nobody else there, virtual time would run away.
        with self._world.lock:
            if not self._reporting:
                self._reporting = True
                self._clock.start(f"{self._name} status", self._report_every_second)

    def _report_every_second(self) -> None:
        period = 0
        begin_s = self._clock.now()
        while not self._closed:
            period += 1
            self._clock.sleep_until(begin_s + period * STATUS_PERIOD_S * self._stretch)
            if self._closed:
                return
            with self._world.lock:
                self._send_status()

    def _send_status(self) -> None:
        bench = self._gyro_bench
        present = self._gyro_bit if bench and bench.mounted else 0
        laser = self._gyro_bit if bench and bench.gyro.heat.is_on else 0
        flags = int(self._running) | (self._mask << 4 if self._running else 0)
        lamps = present | laser << 4
        data = struct.pack(
            "<I4B",
            self._samples & 0xFFFFFFFF,
            flags,
            self._error_bits,
            lamps,
            PROTOCOL_VERSION,
        )
        self._send(STATUS, data)

    def _send(self, identifier: int, data: bytes) -> None:
        self._server.send_frames(frame_text(identifier, self._clock.now(), data.hex()), 1)
