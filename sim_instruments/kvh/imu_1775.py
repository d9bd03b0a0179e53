"""KVH 1775 fibre-optic IMU on RS-422: frames of format C, and its configuration in text.

Frames as public clients read them: header FE 81 FF 57, three gyros and three accelerometers (float,
the most significant byte first), one further float, status, sequence number, CRC-32/MPEG-2; 38
bytes. The sequence number is 0 to 127, and its two lowest bits say what the further float is:
temperature, magnetometer X, Y or Z. Written from that alone, with a checksum of its own.

Assumed here: gyros in deg/s after `=rotunits,deg`, accelerometers in g, magnetometers in gauss and
the temperature in degC; status bits 0, 1, 2 (gyros X, Y, Z) and 4, 5, 6 (accelerometers) are set
while the axis is valid; what is answered to a setting or a query is its name and the value in
force, in capitals; what the unit does not know it answers with `INVALID COMMAND`; outside of the
configuration mode it takes `=config,1` and `?bit` alone; the sequence goes on from where it was; a
frame of the built-in test has six bytes of seven bits, each set while its part is well, and ends
with the low byte of the sum of all bytes before.

A unit that is switched off is silent. One that is switched on streams; this one begins with the
first byte that it hears, so that a bench where nobody looks at it costs nothing.
"""

from __future__ import annotations

import re
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from sim_instruments.generic.nine_axis_model import LASTING_FAULTS, Counters, NineAxisModel
from sim_instruments.instrument import Setting
from sim_instruments.wire.frames import SEED, TABLE, Arrived, FrameInstrument
from sim_instruments.world.nine_axis import Means

FIRMWARE = "1775-1.04"
HEADER = bytes((0xFE, 0x81, 0xFF, 0x57))
SELF_TEST = bytes((0xFE, 0x81, 0x00, 0xAA))
FRAME = np.dtype(
    [
        ("header", "V4"),
        ("gyro", ">f4", 3),
        ("force", ">f4", 3),
        ("further", ">f4"),
        ("status", "u1"),
        ("sequence", "u1"),
        ("crc", ">u4"),
    ]
)
BODY_BYTES = FRAME.itemsize - 4
MODULUS = 128
GYRO_BITS = np.array([1, 2, 4], dtype=np.uint8)
FORCE_BITS = 0x70
GAUSS = 1e-5  # per nT
RATES_HZ = (10, 50, 100, 250, 500, 750, 1000, 5000)
SETTINGS = {
    "OUTPUTFMT": ("C", ("A", "B", "C")),
    "ROTFMT": ("RATE", ("DELTA", "RATE")),
    "ROTUNITS": ("RAD", ("DEG", "RAD")),
    "TEMPUNITS": ("C", ("C", "C_100")),
    "DR": ("1000", tuple(str(rate) for rate in RATES_HZ)),
}
"""Of each setting: what the unit comes with, and what it may be."""
WELL = 0x7F
X_FAILED = 0x01


CRC_TABLE = np.array(TABLE, dtype=np.uint32)


def crc32(frames: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint32]:
    """Return the CRC-32/MPEG-2 of each row of bytes."""
    crc = np.full(len(frames), SEED, dtype=np.uint32)
    for column in frames.T:
        crc = (crc << np.uint32(8)) ^ CRC_TABLE[(crc >> np.uint32(24)) ^ column]
    return crc


def commands_in(pending: bytes) -> Arrived:
    """Return the lines of text that bytes hold, each named by its first word."""
    *lines, rest = re.split(rb"[\r\n]+", pending)
    return Arrived(
        [(f"command {line.split(b',')[0].decode('latin-1')}", line) for line in lines], rest
    )


class Kvh1775(FrameInstrument):
    """The nine-axis sensor of the simulated world, where it has one, as a KVH 1775.

    Truth (`simulator` mapping): `latency` and `clock_error` of the sensor.
    """

    model = "KVH 1775"
    lasting_faults: ClassVar = LASTING_FAULTS

    def __init__(self, setting: Setting) -> None:
        self._serial = setting.serial
        self._settings = {name: value for name, (value, _) in SETTINGS.items()}
        self._awake = self._configures = False
        self._sequence = 0
        self._model = NineAxisModel(setting, self._frames, self._send)
        self.begin_to_serve(setting, commands_in, self._model)

    def _received(self, line: bytes) -> None:
        if not self._model.powered:
            self._awake = False
            return
        if not self._awake:
            self._awake, self._configures = True, False
            self._stream()
        text = line.decode("ascii", "replace").strip().upper()
        if text == "=CONFIG,1":
            self._configures = True
            self._model.stop()
            self._say("CONFIG,1")
        elif text == "?BIT":
            self._server.send("self-test", self._self_test())
        elif self._configures and text:
            self._say(self._configured(text))

    def _configured(self, text: str) -> str:
        """Return what is answered to a line in configuration mode."""
        name, _, value = text[1:].partition(",")
        if text == "=CONFIG,0":
            self._configures = False
            self._stream()
            return text[1:]
        if text == "?IS":
            return f"IS,{self._serial}"
        if text == "?WS":
            return f"WS,{FIRMWARE}"
        known = name in SETTINGS
        if text.startswith("=") and known and value in SETTINGS[name][1]:
            self._settings[name] = value
        elif not (text.startswith("?") and known and not value):
            return "INVALID COMMAND"
        return f"{name},{self._settings[name]}"

    def _stream(self) -> None:
        self._sequence = (self._sequence + self._model.counter) % MODULUS
        self._model.start(float(self._settings["DR"]))

    def _frames(self, counters: Counters, means: Means) -> list[bytes]:
        """Return the frames of outputs in the units that are set."""
        rows = np.zeros(len(counters), dtype=FRAME)
        gyro = means.gyro_deg_per_s
        if self._settings["ROTUNITS"] == "RAD":
            gyro = np.radians(gyro)
        if self._settings["ROTFMT"] == "DELTA":
            gyro = gyro / float(self._settings["DR"])
        sequence = (self._sequence + counters) % MODULUS
        warm = means.temperature_degC * (100.0 if self._settings["TEMPUNITS"] == "C_100" else 1.0)
        further = np.column_stack((warm, means.magnetometer_nT * GAUSS))
        rows["header"] = np.void(HEADER)
        rows["gyro"], rows["force"] = gyro, means.accelerometer_g
        rows["further"] = further[np.arange(len(counters)), sequence % 4]
        rows["status"] = FORCE_BITS | (means.valid @ GYRO_BITS).astype(np.uint8)
        rows["sequence"] = sequence
        body = rows.view(np.uint8).reshape(len(rows), FRAME.itemsize)[:, :BODY_BYTES]
        rows["crc"] = crc32(body)
        data = rows.tobytes()
        return [data[k : k + FRAME.itemsize] for k in range(0, len(data), FRAME.itemsize)]

    def _send(self, frames: Any) -> None:
        # Of formats A and B, whose layouts it does not have, this unit sends nothing.
        if self._settings["OUTPUTFMT"] == "C":
            self._server.send_all("output", frames)

    def _self_test(self) -> bytes:
        first = WELL & ~X_FAILED if self._model.gyro_failed else WELL
        data = SELF_TEST + bytes((first, WELL, WELL, WELL, WELL, WELL))
        return data + bytes((sum(data) & 0xFF,))

    def _say(self, text: str) -> None:
        self._server.send("answer", f"{text}\r\n".encode("ascii"))
