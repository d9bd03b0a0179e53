"""The raw record: whole blocks, read by MCAP and NumPy alone, and nothing kept in memory."""

from __future__ import annotations

import io
import tracemalloc
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from station.record.raw import RawFile, RawIndex
from station.roles.base import ARRIVAL

BLOCK = np.dtype([("counts", np.int32), (ARRIVAL, np.float64)])


def block(first: int, count: int = 10) -> np.ndarray:
    rows = np.zeros(count, dtype=BLOCK)
    rows["counts"] = np.arange(first, first + count)
    rows[ARRIVAL] = 0.1 * np.arange(first, first + count)
    return rows


def test_any_tool_that_reads_mcap_and_numpy_reads_a_raw_file(tmp_path: Path) -> None:
    path = tmp_path / "gyro-000.mcap"
    file = RawFile(path, "gyro", {"counts": "1, pulses"})
    for number in range(20):
        file.write("IA" if number < 10 else "NA", block(10 * number))
    file.close()
    found: dict[str, list[int]] = {}
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            assert channel.message_encoding == "npy"
            assert channel.metadata["counts"] == "1, pulses"
            rows = np.load(io.BytesIO(message.data))
            found.setdefault(channel.topic, []).extend(rows["counts"].tolist())
            assert message.log_time == round(1e9 * rows[ARRIVAL][-1])
    assert found == {"gyro/IA": list(range(100)), "gyro/NA": list(range(100, 200))}


def test_a_block_is_there_for_others_as_soon_as_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "gyro-000.mcap"
    file = RawFile(path, "gyro", {})
    for number in range(5):
        file.write("IA", block(10 * number))
        kept = np.concatenate(list(RawIndex(path).blocks("IA")))
        assert kept["counts"].tolist() == list(range(10 * number + 10))
    file.close()


def test_a_raw_file_keeps_nothing_of_what_it_wrote(tmp_path: Path) -> None:
    file = RawFile(tmp_path / "gyro-000.mcap", "gyro", {})
    rows = block(0)

    def write(blocks: int) -> int:
        for _ in range(blocks):
            file.write("IA", rows)
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        before, after = write(500), write(5000)
    finally:
        tracemalloc.stop()
        file.close()
    # A single number kept for each block would be 40 kB or more.
    assert after - before < 20_000
