"""A CAN bus on a TCP port, in the protocol of the public socketcand daemon (raw mode)."""

from __future__ import annotations

import re
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from importlib.resources import files
from threading import Lock
from typing import Any, ClassVar

from sim_instruments.faults.instrument import FrameTap
from sim_instruments.faults.trigger import frame_name
from sim_instruments.faults.wire import Reply
from sim_instruments.instrument import Electronics, ServedInstrument, Setting
from sim_instruments.wire.tcp import TcpServer

MAX_COMMAND = 4096
OTHER_MODES = ("bcmmode", "controlmode", "isotpmode")


class SocketcandServer(TcpServer):
    """Carry CAN frames between any number of clients and one device.

    The instrument's truth has the bus's `channel`. `received` is called with the identifier and the
    data of each frame that a client sends, as the running participant and with the world's lock
    held; `joined` before a client gets its first frame. One unit on the clock's wire is one frame.

    From the daemon's protocol.md and state_raw.c: a bus that it does not have is refused and the
    connection ended, a frame that is none is passed over in silence, and what one client sends all
    others see. Of its other modes nothing but the answer is simulated.
    """

    def __init__(
        self,
        setting: Setting,
        received: Callable[[int, bytes], None],
        joined: Callable[[], None],
    ) -> None:
        super().__init__(setting.name, setting.port, setting.clock, setting.faults)
        self.channel = setting.truth.text("channel")
        self._wire = setting.clock.wire(self.address)
        self._lock = setting.world.lock
        self._received = received
        self._joined = joined
        self._raw: list[socket.socket] = []
        self._sending = Lock()
        self._tap = FrameTap(setting.faults)

    def send_frames(self, text: str, count: int) -> None:
        """Send `count` frames, already written as `< frame … >`, to every client in raw mode."""
        if self._tap.idle():
            self._send(text, count)
            return
        now, drops, now_s = [], False, self._clock.now()
        for frame in text.split(">")[:-1]:
            _, _, name, time_text, data, _ = frame.split(" ")
            going, ends = self._tap.leaves(name, Reply(bytes.fromhex(data)), now_s)
            drops = drops or ends
            if going is None:
                continue
            changed = f"< frame {name} {time_text} {going.body.hex().upper()} >"
            if going.delay_s > 0:
                self.later(going.delay_s, partial(self._send, changed, 1))
            else:
                now.append(changed)
        self._send("".join(now), len(now))
        if drops:
            self.drop_all()

    def drop(self, client: socket.socket) -> None:
        """End a connection; it gets no frame any more."""
        with self._sending:
            if client in self._raw:
                self._raw.remove(client)
        super().drop(client)

    def _send(self, text: str, count: int, sender: socket.socket | None = None) -> None:
        """Send frames to every client in raw mode but the one that sent them itself."""
        with self._sending:
            clients = [listener for listener in self._raw if listener is not sender]
            if not clients or not count:
                return
            self._wire.streamed(count * len(clients))
            data = text.encode("ascii")
            for client in clients:
                with suppress(OSError):
                    client.sendall(data)
            self._wire.written()

    def serve(self, client: socket.socket) -> None:
        """Greet, open the bus, then carry frames until the client leaves."""
        self._say(client, "< hi >")
        opened, pending = False, ""
        try:
            while data := client.recv(65536):
                *commands, pending = (pending + data.decode("ascii", "replace")).split(">")
                pending = pending[-MAX_COMMAND:]
                for command in commands:
                    words = command.strip(" \r\n<").split()
                    if not words:
                        continue
                    if words[0] == "open" and not opened:
                        opened = words[1:] == [self.channel]
                        self._say(client, "< ok >" if opened else "< error could not open bus >")
                        if not opened:
                            return
                    elif words[0] == "echo":
                        self._say(client, "< echo >")
                    elif words[0] == "rawmode" and opened:
                        self._enter_raw_mode(client)
                    elif words[0] in OTHER_MODES and opened:
                        self._leave_raw_mode(client)
                    elif words[0] == "send" and client in self._dropped:
                        # On a line that is gone, frames are taken off the wire all the same.
                        with self._wire.serving(1):
                            pass
                    elif words[0] == "send" and client in self._raw:
                        with self._wire.serving(1):
                            self._take(client, words[1:])
                    else:
                        self._say(client, "< error unknown command >")
        finally:
            with self._sending:
                if client in self._raw:
                    self._raw.remove(client)

    def _enter_raw_mode(self, client: socket.socket) -> None:
        self._joined()
        # The answer goes out before any frame: clients read it alone.
        with self._sending:
            client.sendall(b"< ok >")
            if client not in self._raw:
                self._raw.append(client)

    def _leave_raw_mode(self, client: socket.socket) -> None:
        """Enter a mode of the daemon in which nothing is simulated but its answer."""
        with self._sending:
            if client in self._raw:
                self._raw.remove(client)
            client.sendall(b"< ok >")

    def _take(self, client: socket.socket, words: list[str]) -> None:
        try:
            identifier, length = int(words[0], 16), int(words[1], 16)
            data = bytes(int(word, 16) for word in words[2:])
        except (IndexError, ValueError):
            return
        if length != len(data) or length > 8:
            return
        text = frame_text(identifier, self._clock.now(), data.hex())
        self._send(text, 1, sender=client)
        with self._lock:
            receive = partial(self._received, identifier, data)
            drops = self._tap.arrives(frame_name(identifier), receive, self._clock.now())
        if drops:
            self.drop_all()

    def _say(self, client: socket.socket, text: str) -> None:
        with self._sending:
            if client not in self._dropped:
                client.sendall(text.encode("ascii"))


def frame_text(identifier: int, time_s: float, data_hex: str) -> str:
    """Return one received frame as the daemon writes it; data in capitals without blanks."""
    name = f"{identifier:03X}" if identifier < 0x800 else f"{identifier:08X}"
    return f"< frame {name} {time_s:.6f} {data_hex.upper()} >"


class CanInstrument(ServedInstrument, ABC):
    """A device on a CAN bus of its own; `_received` carries out a client's frame.

    `dbc` names its message file.
    """

    protocol: ClassVar[str] = "socketcand"
    resource: ClassVar[str] = "socketcand://{host}:{port}"
    dbc: ClassVar[str]
    messages: ClassVar[tuple[int, ...]]
    """The identifiers of what it takes and sends."""
    _server: SocketcandServer

    def knows(self, command: str) -> bool:
        """Whether it takes or sends a message, by its name in the message file."""
        text = (files("config") / "dbc" / f"{self.dbc}.dbc").read_text(encoding="utf-8")
        line = re.search(rf"^BO_ (\d+) {re.escape(command)}:", text, re.MULTILINE)
        return line is not None and int(line[1]) in self.messages

    def begin_to_serve(self, setting: Setting, electronics: Electronics) -> None:
        """Listen from now on."""
        self._clock = setting.clock
        self._electronics = electronics
        self._server = SocketcandServer(setting, self._received, self._joined)
        self._server.begin()

    def describe(self) -> dict[str, Any]:
        """Return what `station sim` prints about this instrument."""
        description, channel = super().describe(), self._server.channel
        description["address"] += f"/{channel}"
        return {
            **description,
            "channel": channel,
            "dbc": str(files("config") / "dbc" / f"{self.dbc}.dbc"),
        }

    @abstractmethod
    def _received(self, identifier: int, data: bytes) -> None:
        """Carry out a frame that came from a client."""

    def _joined(self) -> None:
        """Do what is due before a client gets its first frame."""

    def _send(self, identifier: int, data: bytes) -> None:
        self._send_all([(identifier, data.hex())])

    def _send_all(self, frames: Iterable[tuple[int, str]]) -> None:
        """Send frames, identifier and data in hexadecimal, together."""
        now_s = self._clock.now()
        texts = [frame_text(identifier, now_s, data_hex) for identifier, data_hex in frames]
        self._server.send_frames("".join(texts), len(texts))
