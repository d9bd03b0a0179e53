"""Frames without a length of line: however the bytes come, the same messages are found in them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

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

    @property
    def noise(self) -> st.SearchStrategy[bytes]:
        harmless = sorted(set(range(256)) - set(self.never_first))
        return st.lists(st.sampled_from(harmless), max_size=9).map(bytes)


PROTOCOLS = {
    "pulse-board": Protocol(
        serial_pulse_board.split, frames_of(serial_pulse_board), bytes(serial_pulse_board.PAYLOADS)
    ),
    "navigator": Protocol(
        serial_navigator.split, frames_of(serial_navigator), serial_navigator.SYNC
    ),
    "kvh-1775": Protocol(
        kvh.split,
        st.binary(min_size=30, max_size=30).map(kvh_output)
        | st.binary(min_size=6, max_size=6).map(kvh_self_test)
        | st.from_regex(r"[A-Z0-9][ -~]{1,40}", fullmatch=True).map(kvh_line),
        kvh.MARK + bytes(range(0x20, 0x7F)),
    ),
}
every_protocol = pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=PROTOCOLS.keys())


def split_in_pieces(split: Splitter, stream: bytes, sizes: Sequence[int]) -> Split:
    """Return what is found in a stream that comes in pieces, the last of them all that is left."""
    frames: list[Message] = []
    pending, skipped, position = b"", 0, 0
    for size in (*sizes, len(stream)):
        found = split(pending + stream[position : position + size])
        frames, pending, skipped = frames + found.frames, found.rest, skipped + found.skipped
        position += size
    return Split(frames, pending, skipped)


PIECES = st.lists(st.integers(0, 60), max_size=40)


@every_protocol
@given(drawn=st.data(), sizes=PIECES)
def test_no_message_is_lost_or_doubled_among_bytes_of_none(
    protocol: Protocol, drawn: st.DataObject, sizes: list[int]
) -> None:
    sent = drawn.draw(st.lists(st.tuples(protocol.noise, protocol.messages), max_size=8))
    stream = b"".join(noise + data for noise, (_, data) in sent)
    found = split_in_pieces(protocol.split, stream, sizes)
    assert found.frames == [message for _, (message, _) in sent]
    assert found.skipped == sum(len(noise) for noise, _ in sent) and not found.rest


@every_protocol
@given(drawn=st.data(), sizes=PIECES)
def test_any_bytes_hold_the_same_messages_in_one_piece_and_in_many(
    protocol: Protocol, drawn: st.DataObject, sizes: list[int]
) -> None:
    beginnings = protocol.messages.flatmap(
        lambda sent: st.integers(0, len(sent[1])).map(lambda size: sent[1][:size])
    )
    anything = st.one_of(
        protocol.messages.map(lambda sent: sent[1]), beginnings, st.binary(max_size=9)
    )
    stream = b"".join(drawn.draw(st.lists(anything, max_size=8))) + LONGER_THAN_A_FRAME
    at_once = protocol.split(stream)
    assert split_in_pieces(protocol.split, stream, sizes) == at_once


@pytest.mark.parametrize("name", ["pulse-board", "navigator"])
@given(drawn=st.data())
def test_a_frame_with_one_wrong_bit_is_none(name: str, drawn: st.DataObject) -> None:
    protocol = PROTOCOLS[name]
    (_, damaged), (message, good) = (drawn.draw(protocol.messages) for _ in range(2))
    bit = drawn.draw(st.integers(0, 8 * len(damaged) - 1))
    wrong = bytearray(damaged)
    wrong[bit // 8] ^= 1 << bit % 8
    assert protocol.split(bytes(wrong) + good + LONGER_THAN_A_FRAME).frames == [message]
