"""A CAN bus on a TCP port, in the protocol of the public socketcand daemon (raw and BCM mode)."""

from __future__ import annotations

import re
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from itertools import count
from operator import and_
from threading import Lock
from typing import Any, ClassVar

from sim_instruments.faults.instrument import FrameTap
from sim_instruments.faults.trigger import frame_name
from sim_instruments.faults.wire import Reply
from sim_instruments.instrument import Electronics, ServedInstrument, Setting
from sim_instruments.wire.tcp import TcpServer

MAX_COMMAND = 4096
FIRST_EXTENDED, EXTENDED_DIGITS = 0x800, 8
HOST_BEGAN_S = 1_795_331_000.0
"""By the clock of the daemon's host, the beginning of run time."""

Words = list[str]


class Subscription:
    """Of which frames of an identifier a client in BCM mode is told, and how often at most.

    `mask` names the bits whose change is looked for; without one every frame counts.
    """

    def __init__(self, least_s: float, mask: bytes | None) -> None:
        self._least_s, self._mask = least_s, mask
        self._last: bytes | None = None
        self._due_s = 0.0

    def takes(self, data: bytes, now_s: float) -> bool:
        """Return whether a frame goes to the client."""
        seen = data if self._mask is None else bytes(map(and_, data, self._mask))
        changed = self._mask is None or seen != self._last
        if not changed or now_s < self._due_s:
            return False
        self._last, self._due_s = seen, now_s + self._least_s
        return True


@dataclass
class Job:
    """A frame that the daemon sends again and again."""

    interval_s: float
    identifier: int
    data: bytes


class Client:
    """What the daemon keeps of one client: its mode, `nobus` at first, and what it asked for."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.mode = "nobus"
        self.forget()

    def forget(self) -> None:
        """Forget its subscriptions and end its jobs."""
        self.subscriptions: dict[str, Subscription] = {}
        self.jobs: dict[str, Job] = {}


class SocketcandServer(TcpServer):
    """Carry CAN frames between any number of clients and one device.

    The instrument's truth has the bus's `channel`. `received` is called with the identifier and the
    data of each frame that a client sends, as the running participant and with the world's lock
    held; `joined` before a client gets its first frame. One unit on the clock's wire is one frame.

    From the daemon's protocol.md, state_nobus.c, state_bcm.c and state_raw.c: a bus that it does
    not have is refused and the connection ended; after `< open >` a client is in BCM mode, in which
    it sends frames once (`send`) or again and again (`add`, `update`, `delete`) and gets those that
    it subscribes to (`subscribe`, `filter`, `unsubscribe`), their bytes with blanks between; in raw
    mode it gets all, their bytes in capitals without blanks. Frames carry the time of the host. A
    frame or a number that is none is passed over in silence, and what one client sends all others
    see. What is unknown before a bus is open is answered by an error and `< ok >`. Of `filter` with
    a throttle the first of an interval is sent, not the last; `muxfilter` is taken and nothing is
    sent for it. Of its other modes nothing but the answer is simulated.
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
        self._told: list[Client] = []
        """Clients in BCM mode that have subscribed to something."""
        self._sending = Lock()
        self._tap = FrameTap(setting.faults)
        self._jobs = count(1)

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
            self._leave(client)
        super().drop(client)

    def _send(self, text: str, count: int, sender: socket.socket | None = None) -> None:
        """Send frames to every client in raw mode but the one that sent them itself.

        A client in BCM mode gets those that it has subscribed to.
        """
        with self._sending:
            clients = [listener for listener in self._raw if listener is not sender]
            told = [client for client in self._told if client.connection is not sender]
            if not (clients or told) or not count:
                return
            selected = [(client.connection, self._subscribed(client, text)) for client in told]
            units = count * len(clients) + sum(len(frames) for _, frames in selected)
            self._wire.streamed(units)
            data = text.encode("ascii")
            for client in clients:
                with suppress(OSError):
                    client.sendall(data)
            for client, frames in selected:
                with suppress(OSError):
                    client.sendall("".join(frames).encode("ascii"))
            self._wire.written()

    def _subscribed(self, client: Client, text: str) -> list[str]:
        """Return the frames that a client has subscribed to, as they are written in BCM mode."""
        frames, now_s = [], self._clock.now()
        for frame in text.split(">")[:-1]:
            _, _, name, time_text, digits, _ = frame.split(" ")
            data = bytes.fromhex(digits)
            subscription = client.subscriptions.get(name)
            if subscription is not None and subscription.takes(data, now_s):
                frames.append(f"< frame {name} {time_text} {data.hex(' ').upper()}  >")
        return frames

    def serve(self, client: socket.socket) -> None:
        """Greet, open the bus, then carry frames until the client leaves."""
        self._say(client, "< hi >")
        state, pending = Client(client), ""
        acts: dict[str, dict[str, Callable[[Client, Words], None]]] = {
            "bcmmode": {
                "echo": self._echo,
                "send": self._take,
                "add": self._add,
                "update": self._update,
                "delete": self._delete,
                "subscribe": self._subscribe,
                "filter": self._subscribe,
                "muxfilter": lambda state, words: None,
                "unsubscribe": self._unsubscribe,
            },
            "rawmode": {"echo": self._echo, "send": self._take},
            "controlmode": {"echo": self._echo},
            "isotpmode": {"echo": self._echo},
        }
        try:
            while data := client.recv(65536):
                *commands, pending = (pending + data.decode("ascii", "replace")).split(">")
                pending = pending[-MAX_COMMAND:]
                for command in commands:
                    words = command.strip(" \r\n<").split()
                    if not words:
                        continue
                    if state.mode == "nobus":
                        if not self._opens(state, words):
                            return
                    elif words[0] in acts:
                        self._enter(state, words[0])
                    elif words[0] in (known := acts[state.mode]):
                        with suppress(IndexError, ValueError):  # what is none is passed over
                            known[words[0]](state, words[1:])
                    else:
                        self._say(client, "< error unknown command >")
        finally:
            with self._sending:
                self._leave(client)
            state.forget()

    def _opens(self, state: Client, words: Words) -> bool:
        """Answer a client that has no bus yet; return whether its connection stays."""
        if words[0] != "open":
            self._say(state.connection, "< error unknown command >< ok >")
            return True
        if words[1:] != [self.channel]:
            self._say(state.connection, "< error could not open bus >")
            return False
        state.mode = "bcmmode"
        self._say(state.connection, "< ok >")
        return True

    def _enter(self, state: Client, mode: str) -> None:
        """Enter a mode; what the client asked for in the one before is forgotten."""
        if mode == "rawmode":
            self._joined()
        if mode != state.mode:
            state.forget()
        # The answer goes out before any frame of the new mode.
        with self._sending:
            if state.connection in self._dropped:
                return
            self._leave(state.connection)
            state.connection.sendall(b"< ok >")
            state.mode = mode
            if mode == "rawmode":
                self._raw.append(state.connection)
            elif mode == "bcmmode" and state.subscriptions:
                self._told.append(state)

    def _leave(self, client: socket.socket) -> None:
        """Send a client no more frames (lock held)."""
        self._raw = [listener for listener in self._raw if listener is not client]
        self._told = [listener for listener in self._told if listener.connection is not client]

    def _echo(self, state: Client, words: Words) -> None:
        self._say(state.connection, "< echo >")

    def _subscribe(self, state: Client, words: Words) -> None:
        """Subscribe to an identifier, or to the bits of it that a mask names."""
        least_s = int(words[0]) + 1e-6 * int(words[1])
        name = name_of(int(words[2], 16), extended=len(words[2]) == EXTENDED_DIGITS)
        mask = data_of(words[3:]) if len(words) > 3 else None
        if not state.subscriptions:
            self._joined()
        with self._sending:
            state.subscriptions[name] = Subscription(least_s, mask)
            if state not in self._told:
                self._told.append(state)

    def _unsubscribe(self, state: Client, words: Words) -> None:
        name = name_of(int(words[0], 16), extended=len(words[0]) == EXTENDED_DIGITS)
        with self._sending:
            state.subscriptions.pop(name, None)
            if not state.subscriptions:
                self._leave(state.connection)

    def _add(self, state: Client, words: Words) -> None:
        """Send a frame now and, where an interval is given, again and again."""
        job = Job(int(words[0]) + 1e-6 * int(words[1]), int(words[2], 16), data_of(words[3:]))
        state.jobs[words[2]] = job

        def send() -> float | None:
            if state.jobs.get(words[2]) is not job:
                return None
            self._put(state.connection, job.identifier, job.data)
            return self._clock.now() + job.interval_s if job.interval_s > 0 else None

        self._clock.repeat(f"{self._name} job {next(self._jobs):06d}", self._clock.now(), send)

    def _update(self, state: Client, words: Words) -> None:
        if words[0] in state.jobs:
            state.jobs[words[0]].data = data_of(words[1:])

    def _delete(self, state: Client, words: Words) -> None:
        state.jobs.pop(words[0], None)

    def _take(self, state: Client, words: Words) -> None:
        with self._wire.serving(1):
            # On a line that is gone, frames are taken off the wire all the same.
            if state.connection not in self._dropped:
                self._put(state.connection, int(words[0], 16), data_of(words[1:]))

    def _put(self, client: socket.socket, identifier: int, data: bytes) -> None:
        """Give a client's frame to the other clients and to the device."""
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


def data_of(words: Words) -> bytes:
    """Return the bytes of a frame, of their number and their hexadecimal digits.

    Raises ValueError where the number does not agree, or is above 8.
    """
    data = bytes(int(word, 16) for word in words[1:])
    if int(words[0]) != len(data) or len(data) > 8:
        raise ValueError(words)
    return data


def name_of(identifier: int, *, extended: bool) -> str:
    """Return an identifier as the daemon writes it: in 3 digits, or in 8 where it is extended."""
    return f"{identifier:08X}" if extended else f"{identifier:03X}"


def frame_text(identifier: int, time_s: float, data_hex: str) -> str:
    """Return a frame that came at run time `time_s` as the daemon writes it in raw mode."""
    name = name_of(identifier, extended=identifier >= FIRST_EXTENDED)
    return f"< frame {name} {HOST_BEGAN_S + time_s:.6f} {data_hex.upper()} >"


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
