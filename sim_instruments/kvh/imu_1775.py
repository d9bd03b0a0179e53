"""KVH 1775 fibre-optic IMU on RS-422: frames of formats A, B and C, its configuration in text.

From the interface control document ICD 56-0298 Rev B. After power-up one frame of the built-in test
comes, then data, unasked (p.13). `=CONFIG,1` ends the data and is answered; `=CONFIG,0` begins them
and is not.
In configuration mode a line that is none is answered `INVALID,<echo>`, a bad value `USAGE` or
`ERROR`; in normal mode all but `=CONFIG,1`, `?BIT` and `?BIT,2` is passed over. The built-in test
is answered after the next data, and its check sum is the sum of all bytes before. Settings outlast
the power, CONFIG and ECHO do not; `=RSTCFG` brings those of the maker back, the baud rate aside
(p.56). ECHO counts how often it was called, or takes a number (p.34). `=MSYNC,EXT` leaves the
filter AVE behind, and without its signal nothing is output. `?HELP` lists the commands (p.44).

Frames as public clients read them: header FE 81 FF 57, three gyros and three accelerometers (float,
the most significant byte first), one further float, status, sequence number, CRC-32/MPEG-2; 38
bytes. The sequence number is 0 to 127, and its two lowest bits say what the further float is:
temperature, magnetometer X, Y or Z. Format A (header FE 81 FF 55, 36 bytes) has the temperature as
a whole number after the sequence number; format B (header FE 81 FF 56, 40 bytes; p.15) is A with a
time stamp of four bytes before the status. Written from that alone, with a checksum of its own.

Assumed here: accelerometers in g; what follows `USAGE` and `ERROR`; the sequence goes on from where
it was; a frame of the built-in test has six bytes of seven bits, eight after `?BIT,2`, each bit set
while its part is well (the log of p.46 has 7F for each); the time stamp counts microseconds since
power-up and begins again after 2^32 (two public clients, one of which counts from a pulse per
second); the answer of `?TEMP`. Filters change nothing: outputs are means.

A unit that is switched off is silent. One that is switched on streams; this one begins when
somebody comes on the line, so that a bench where nobody looks at it costs nothing.
"""

from __future__ import annotations

import re
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from sim_instruments.generic.nine_axis_model import LASTING_FAULTS, Counters, NineAxisModel
from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError
from sim_instruments.wire.frames import SEED, TABLE, Arrived, FrameInstrument
from sim_instruments.world.nine_axis_sensor import Means

FIRMWARE = (
    "1775 IMU",
    "ICB DSP Rev B Version: 104",
    "ICB FPGA Rev: 2A",
    "GCB DSP Rev C Version: 31",
    "GCB FPGA Rev: D",
)
HEADER_A, HEADER_B, HEADER = (bytes((0xFE, 0x81, 0xFF, last)) for last in (0x55, 0x56, 0x57))
SELF_TEST, LONG_SELF_TEST = bytes((0xFE, 0x81, 0x00, 0xAA)), bytes((0xFE, 0x81, 0x00, 0xAB))
SELF_TESTS = {"?BIT": (SELF_TEST, 6), "?BIT,2": (LONG_SELF_TEST, 8)}
"""By query: header of the answer and how many bytes of seven bits it has."""

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
FRAME_A = np.dtype(
    [
        ("header", "V4"),
        ("gyro", ">f4", 3),
        ("force", ">f4", 3),
        ("status", "u1"),
        ("sequence", "u1"),
        ("temperature", ">i2"),
        ("crc", ">u4"),
    ]
)
FRAME_B = np.dtype(
    [
        ("header", "V4"),
        ("gyro", ">f4", 3),
        ("force", ">f4", 3),
        ("time_us", ">u4"),
        ("status", "u1"),
        ("sequence", "u1"),
        ("temperature", ">i2"),
        ("crc", ">u4"),
    ]
)
FORMATS = {"A": (FRAME_A, HEADER_A), "B": (FRAME_B, HEADER_B), "C": (FRAME, HEADER)}
STAMPS = 1 << 32
LOOK_S = 1.0
"""How often it is looked at whether somebody has switched the unit on or off."""
MODULUS = 128
GYRO_BITS = np.array([1, 2, 4], dtype=np.uint8)
FORCE_BITS = 0x70
GAUSS = 1e-5  # per nT
RATES_HZ = (1, 5, 10, 25, 50, 100, 250, 500, 750, 1000, 3600, 5000)
BAUDS = ("9600", "19200", "38400", "57600", "115200", "460800", "576000", "921600", "4147200")
"""ICD 56-0298 B p.30."""
UNIT_MATRIX = ",".join(f"{value:+.6E}" for value in np.eye(3).ravel())
SETTINGS = {
    "OUTPUTFMT": ("A", ("A", "B", "C")),
    "ROTFMT": ("DELTA", ("DELTA", "RATE", "RESET")),
    "ROTUNITS": ("RAD", ("DEG", "RAD")),
    "DR": ("1000", tuple(str(rate) for rate in RATES_HZ)),
    "TEMPUNITS": ("C", ("C", "F", "C_100", "F_100")),
    "LINFMT": ("ACCEL", ("ACCEL", "DELTA")),
    "LINUNITS": ("METERS", ("METERS", "FEET")),
    "FILTEN": ("1", ("0", "1")),
    "MSYNC": ("IMU", ("IMU", "EXT")),
    "BAUD": ("921600", BAUDS),
}
"""Of each setting of one word: what the unit comes with, and what it may be."""

FIXED = ("=CONFIG,1", "=CONFIG,0", "=RESTART", "=RSTCFG", "=ECHO", "?ECHO", "?TEMP")
FILTERS = ("CHEBY", "BUTTER", "AVE")
FACTORY = {
    **{name: first for name, (first, _) in SETTINGS.items()},
    "AXES": UNIT_MATRIX,
    "FILTTYPE,A": "CHEBY",
    "FILTTYPE,G": "CHEBY",
}
STANDARD_GRAVITY, METRES_PER_FOOT = 9.80665, 0.3048
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

    Truth (`simulator` mapping): `latency` and `clock_error` of the sensor; `settings`, what
    somebody before has left in it by name, as `{OUTPUTFMT: B, AXES: "0,1,0,1,0,0,0,0,-1"}`; the
    maker's where nothing is given.
    """

    model = "KVH 1775"
    lasting_faults: ClassVar = LASTING_FAULTS

    def __init__(self, setting: Setting) -> None:
        self._fixed = {
            "?CONFIG": "CONFIG,1",
            "?IS": f"IS,{setting.serial}",
            "?WS": "\r\n".join(FIRMWARE),
        }
        names = [*FIXED, *self._fixed, *SELF_TESTS]
        names += [f"{sign}{name}" for name in FACTORY for sign in "=?"]
        self._fixed["?HELP"] = self._fixed["=HELP"] = "\r\n".join(sorted(names))
        self._settings = dict(FACTORY)
        if "settings" in setting.truth:
            left = setting.truth.section("settings")
            for name in FACTORY:
                if name in left and not self._sets(name, left.text(name).upper()):
                    raise SimulationError(f"{left.where}.{name}: it has no such value")
        self._awake = self._configures = self._ended = False
        self._echoes = 0
        self._tests: list[bytes] = []
        self._sequence = 0
        self._model = NineAxisModel(setting, self._frames, self._send)
        self._clock, self._lock, self._name = setting.clock, setting.world.lock, setting.name
        self._on_s = self._begin_s = self._clock.now()
        self.begin_to_serve(setting, commands_in, self._model)
        self._looks = False
        self._server.when_connected(self._begin_to_look)

    def close(self) -> None:
        """Hang up; nobody looks any more whether it is switched on."""
        self._ended = True
        super().close()

    def knows(self, command: str) -> bool:
        """Whether the sensor has a command or a setting."""
        own = command in (*SELF_TESTS, *FIXED, *self._fixed)
        return own or setting_of(command[1:])[0] in FACTORY

    def _begin_to_look(self) -> None:
        if not self._looks:
            self._looks = True
            self._clock.repeat(f"{self._name} power", self._clock.now(), self._look)

    def _look(self) -> float | None:
        """Notice that the unit was switched on or off; one that is on streams unasked."""
        if self._ended:
            return None
        with self._lock:
            if not self._model.powered:
                self._awake = False
            elif not self._awake:
                self._power_up()
        return self._clock.now() + LOOK_S

    def _received(self, line: bytes) -> None:
        if not self._model.powered:
            self._awake = False
            return
        if not self._awake:
            self._power_up()
        text = line.decode("ascii", "replace").strip().upper()
        if text == "=CONFIG,1":
            self._configures = True
            self._model.stop()
            self._say("CONFIG,1")
        elif self._configures and text:
            answer = self._configured(text)
            if answer:
                self._say(answer)
        elif text in SELF_TESTS:
            self._tests.append(self._self_test(*SELF_TESTS[text]))

    def _power_up(self) -> None:
        self._awake, self._configures, self._echoes = True, False, 0
        self._on_s = self._clock.now()
        self._server.send("self-test", self._self_test(*SELF_TESTS["?BIT"]))
        self._stream()

    def _configured(self, text: str) -> str:
        """Return what is answered to a line in configuration mode, nothing to some."""
        if text == "=CONFIG,0":
            self._configures = False
            self._stream()
            return ""
        if text == "=RESTART":
            self._power_up()
            return ""
        if text == "=RSTCFG":
            self._settings = {**FACTORY, "BAUD": self._settings["BAUD"]}
            return "RSTCFG"
        if text == "?TEMP":
            warm = self._in_its_units(np.array([self._model.temperature_degC()]))
            return f"TEMP,{warm[0]:.2f}"
        if text[1:].split(",")[0] == "ECHO":
            return self._echoed(text)
        if text in self._fixed:
            return self._fixed[text]
        asks, name, value = text[:1], *setting_of(text[1:])
        if asks not in "?=" or name not in FACTORY:
            return f"INVALID,{text}"
        if asks == "?" and value:
            return f"USAGE,?{name}"
        if asks == "=" and not self._sets(name, value):
            return f"ERROR,{text}" if value else f"USAGE,={name},<value>"
        return f"{name},{self._settings[name]}"

    def _echoed(self, text: str) -> str:
        """Count a call of ECHO, or take the number that it gives."""
        _, _, value = text.partition(",")
        if not value:
            self._echoes += 1
        elif value == "RESET" or value.isdecimal():
            self._echoes = 0 if value == "RESET" else int(value)
        else:
            return f"ERROR,{text}"
        return f"ECHO,{self._echoes}"

    def _sets(self, name: str, value: str) -> bool:
        """Take a value; return whether the setting may have it."""
        if name == "AXES":
            try:
                numbers = [float(number) for number in value.split(",")]
            except ValueError:
                return False
            if len(numbers) != 9 or not np.isfinite(numbers).all():
                return False
            value = ",".join(f"{number:+.6E}" for number in numbers)
        elif value not in (FILTERS if name.startswith("FILTTYPE") else SETTINGS[name][1]):
            return False
        self._settings[name] = value
        if (name, value) == ("MSYNC", "EXT"):
            self._settings["FILTTYPE,A"] = self._settings["FILTTYPE,G"] = "AVE"
        return True

    def _stream(self) -> None:
        self._begin_s = self._clock.now()
        self._sequence = (self._sequence + self._model.counter) % MODULUS
        self._model.start(float(self._settings["DR"]))

    def _frames(self, counters: Counters, means: Means) -> list[bytes]:
        """Return the frames of outputs in the format and units that are set."""
        kept = self._settings
        layout, header = FORMATS[kept["OUTPUTFMT"]]
        named = layout.names or ()
        rows = np.zeros(len(counters), dtype=layout)
        axes = np.array([float(number) for number in kept["AXES"].split(",")]).reshape(3, 3).T
        gyro, force = means.gyro_deg_per_s @ axes, means.accelerometer_g @ axes
        if kept["ROTUNITS"] == "RAD":
            gyro = np.radians(gyro)
        if kept["ROTFMT"] != "RATE":
            gyro = gyro / float(kept["DR"])
        if kept["LINFMT"] == "DELTA":
            force = force * STANDARD_GRAVITY / float(kept["DR"])
            force = force / METRES_PER_FOOT if kept["LINUNITS"] == "FEET" else force
        sequence = (self._sequence + counters) % MODULUS
        warm = self._in_its_units(means.temperature_degC)
        rows["header"] = np.void(header)
        rows["gyro"], rows["force"] = gyro, force
        rows["status"] = FORCE_BITS | (means.valid @ GYRO_BITS).astype(np.uint8)
        rows["sequence"] = sequence
        if "time_us" in named:
            since_s = self._begin_s - self._on_s + counters / float(kept["DR"])
            rows["time_us"] = np.round(1e6 * since_s) % STAMPS
        if "further" in named:
            further = np.column_stack((warm, means.magnetometer_nT * GAUSS))
            rows["further"] = further[np.arange(len(counters)), sequence % 4]
        else:
            rows["temperature"] = np.round(warm)
        size = rows.dtype.itemsize
        rows["crc"] = crc32(rows.view(np.uint8).reshape(len(rows), size)[:, : size - 4])
        data = rows.tobytes()
        return [data[k : k + size] for k in range(0, len(data), size)]

    def _in_its_units(self, warm_degC: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        units = self._settings["TEMPUNITS"]
        warm = warm_degC * 1.8 + 32.0 if units.startswith("F") else warm_degC
        return warm * 100.0 if units.endswith("_100") else warm

    def _send(self, frames: Any) -> None:
        if self._settings["MSYNC"] == "IMU":
            self._server.send_all("output", frames)
        tests, self._tests = self._tests, []
        for test in tests:
            self._server.send("self-test", test)

    def _self_test(self, header: bytes, count: int) -> bytes:
        first = WELL & ~X_FAILED if self._model.gyro_failed else WELL
        data = header + bytes((first, *[WELL] * (count - 1)))
        return data + bytes((sum(data) & 0xFF,))

    def _say(self, text: str) -> None:
        self._server.send("answer", f"{text}\r\n".encode("ascii"))


def setting_of(text: str) -> tuple[str, str]:
    """Return the name of a setting, with a filter's the letter of its sensors, and a value."""
    name, _, value = text.partition(",")
    if name == "FILTTYPE":
        letter, _, value = value.partition(",")
        name = f"{name},{letter}"
    return name, value
