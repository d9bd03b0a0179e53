"""Frames without a length of line: however the bytes come, the same messages are found in them."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.generic import serial_navigator, serial_pulse_board
from drivers.kvh import imu_1775_frames as kvh
from drivers.transport.serial_stream import Split, Splitter, crc32_mpeg2

Message = tuple[int, bytes]
"""Its kind and its payload."""
LONGER_THAN_A_FRAME = bytes(300)


def frames_of(module: object) -> st.SearchStrategy[tuple[Message, bytes]]:
    """Return the messages of a protocol whose frames are a kind, a payload and a check sum."""
    kinds = st.sampled_from(sorted(module.PAYLOADS))  # type: ignore[attr-defined]

    def frame_of(kind: int) -> st.SearchStrategy[tuple[Message, bytes]]:
        size = module.PAYLOADS[kind].size  # type: ignore[attr-defined]
        payloads = st.binary(min_size=size, max_size=size)
        return payloads.map(lambda payload: ((kind, payload), module.frame(kind, payload)))  # type: ignore[attr-defined]

    return kinds.flatmap(frame_of)


def kvh_output(payload: bytes) -> tuple[Message, bytes]:
    body = kvh.OUTPUT_HEADER + payload
    return (kvh.OUTPUT, payload), body + struct.pack(">I", crc32_mpeg2(body))


def kvh_self_test(payload: bytes) -> tuple[Message, bytes]:
    body = bytes.fromhex("FE8100AA") + payload
    return (kvh.SELF_TEST, payload), body + bytes([sum(body) % 256])


def kvh_line(text: str) -> tuple[Message, bytes]:
    return (kvh.TEXT, text.encode("ascii")), text.encode("ascii") + b"\r\n"


@dataclass(frozen=True)
class Protocol:
    """What goes over a line: messages with their bytes, and bytes that can begin none of them."""

    split: Splitter
    messages: st.SearchStrategy[tuple[Message, bytes]]
    never_first: bytes
    size_of: Callable[[Message], int | None]
    """The bytes that a message takes; None where that depends on how it ends."""

    @property
    def noise(self) -> st.SearchStrategy[bytes]:
        harmless = sorted(set(range(256)) - set(self.never_first))
        return st.lists(st.sampled_from(harmless), max_size=9).map(bytes)


PROTOCOLS = {
    "pulse-board": Protocol(
        serial_pulse_board.split,
        frames_of(serial_pulse_board),
        bytes(serial_pulse_board.PAYLOADS),
        lambda message: len(serial_pulse_board.frame(*message)),
    ),
    "navigator": Protocol(
        serial_navigator.split,
        frames_of(serial_navigator),
        serial_navigator.SYNC,
        lambda message: len(serial_navigator.frame(*message)),
    ),
    "kvh-1775": Protocol(
        kvh.split,
        st.binary(min_size=30, max_size=30).map(kvh_output)
        | st.binary(min_size=6, max_size=6).map(kvh_self_test)
        | st.from_regex(r"[A-Z0-9][ -~]{1,40}", fullmatch=True).map(kvh_line),
        kvh.MARK + bytes(range(0x20, 0x7F)),
        lambda message: {kvh.OUTPUT: 38, kvh.SELF_TEST: 11}.get(message[0]),
    ),
}
every_protocol = pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=PROTOCOLS.keys())


def split_in_pieces(split: Splitter, parts: Sequence[bytes], draw: st.DrawFn) -> Split:
    """Return what is found in a stream that is cut anywhere, and often where a part of it ends."""
    stream = b"".join(parts)
    cuts = draw(st.lists(st.integers(0, len(stream)), max_size=9))
    cuts += [end for end in accumulate(map(len, parts)) if draw(st.booleans())]
    frames: list[Message] = []
    pending, skipped = b"", 0
    for begin, end in pairwise([0, *sorted(cuts), len(stream)]):
        found = split(pending + stream[begin:end])
        frames, pending, skipped = frames + found.frames, found.rest, skipped + found.skipped
    return Split(frames, pending, skipped)


@every_protocol
@given(drawn=st.data())
def test_no_message_is_lost_or_doubled_among_bytes_of_none(
    protocol: Protocol, drawn: st.DataObject
) -> None:
    sent = drawn.draw(st.lists(st.tuples(protocol.noise, protocol.messages), max_size=8))
    parts = [part for noise, (_, data) in sent for part in (noise, data)]
    found = split_in_pieces(protocol.split, parts, drawn.draw)
    assert found.frames == [message for _, (message, _) in sent]
    assert found.skipped == sum(len(noise) for noise, _ in sent) and not found.rest


@every_protocol
@given(drawn=st.data())
def test_any_bytes_hold_the_same_messages_in_one_piece_and_in_many(
    protocol: Protocol, drawn: st.DataObject
) -> None:
    """What begins like a message and is none keeps nothing back, and each byte counts once."""
    beginnings = st.tuples(protocol.messages, st.integers(1, 12)).map(
        lambda begun: begun[0][1][: begun[1]]
    )
    whole = protocol.messages.map(lambda sent: sent[1])
    parts = drawn.draw(st.lists(whole | beginnings | st.binary(max_size=9), max_size=8))
    parts.append(LONGER_THAN_A_FRAME)
    at_once = protocol.split(b"".join(parts))
    assert split_in_pieces(protocol.split, parts, drawn.draw) == at_once
    sizes = [protocol.size_of(message) for message in at_once.frames]
    if None not in sizes:
        used = sum(size for size in sizes if size)
        assert used + at_once.skipped + len(at_once.rest) == sum(map(len, parts))


@pytest.mark.parametrize("name", ["pulse-board", "navigator"])
@given(drawn=st.data())
def test_a_frame_with_one_wrong_bit_is_none(name: str, drawn: st.DataObject) -> None:
    protocol = PROTOCOLS[name]
    (_, damaged), (message, good) = (drawn.draw(protocol.messages) for _ in range(2))
    bit = drawn.draw(st.integers(0, 8 * len(damaged) - 1))
    wrong = bytearray(damaged)
    wrong[bit // 8] ^= 1 << bit % 8
    assert protocol.split(bytes(wrong) + good + LONGER_THAN_A_FRAME).frames == [message]
