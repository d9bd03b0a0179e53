"""One picture of a run on terminals of several sizes: all parts are there, nothing is clipped."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from io import StringIO
from typing import Any

import pytest
from rich.cells import cell_len
from rich.console import Console

from station.control.run_reader import Times
from station.record.series import Trace
from station.speech import HERE
from station.view.drawing import (
    Drawing,
    Picture,
    age_words,
    read_words,
    step_time,
    time_words,
    window,
)
from station.view.sparkline import sparkline

NOW = datetime(2026, 3, 1, 14, 5, 27, tzinfo=UTC)
TITLES = (
    "Mount the gyro in the centre of the coil",
    "Connect the cables, identify the instruments",
    "Switch the gyro on and warm it up",
    "Drive coil X with a sine of frequency f and amplitude M",
    "Record N samples of the gyro, and the field",
    "Transform the record",
    "Draw the spectrum 2|X|/N against k/T",
    "Read the peak near f, divide by M",
    "Repeat S3 to S7 for coils Y and Z",
    "Switch the coils and the gyro off",
)
STATE: dict[str, Any] = {
    "run": "20260301T134700Z-rlg-magnetic-sensitivity-SN-0042",
    "procedure": "rlg-magnetic-sensitivity",
    "dut": {"model": "RLG-50", "serial": "SN-0042"},
    "state": "running",
    "sentence": "running",
    "message": "IA is being recorded",
    "steps": [
        {
            "number": f"S{n}",
            "title": title,
            "state": "done" if n < 4 else "waits",
            "began_s": 270.0 * n if n < 5 else None,
            "took_s": 270.0 if n < 4 else None,
            "expected_s": 264.4,
        }
        for n, title in enumerate(TITLES)
    ],
    "units_done": 1,
    "units_planned": 4,
    "prompt": None,
    "safe": None,
    "left_out": [],
    "log": [{"t": 30.0 * n, "text": f"sentence {n} of the log"} for n in range(40)],
}
STATE["steps"][4]["state"] = "now"
TIMES = Times(1080.0, 1560.0, NOW + timedelta(seconds=1560))
READ = (
    ("coil_supply.x", "sine 0.1 Hz, 3.33 A, 1 mT", {"output": "on", "current": "2.774 A"}),
    ("gaussmeter", "range for 1.5 mT", {"field": "0.832 mT"}),
    ("thermal_chamber", "20 degC", {"temperature": "20.04 degC"}),
    ("turntable", "10 deg/s", {"rate": "9.998 deg/s", "angle": "112.4 deg"}),
)
LIVE: dict[str, Any] = {
    "now": "IA: 1566 of 5500 samples",
    "instruments": [
        {
            "instrument": name,
            "set": set_,
            "read": [{"quantity": key, "text": text, "age_s": 0.2} for key, text in read.items()],
        }
        for name, set_, read in READ
    ],
    "interlocks": [
        {"name": "chain", "state": "clear", "said": "the chain is closed"},
        {"name": "coil-x-current", "state": "waits", "said": "3.4 A is above 3.35 A"},
    ],
}
TRACE = Trace("gyro_acquisition", "rate", "deg/h", [9.625, 9.72, 9.56, 9.662])
PARTS = (
    "▶ running",
    "device RLG-50 SN-0042   14:05:27",
    STATE["run"],
    "41 %",
    "unit of work 2 of 4",
    "elapsed 18 min 00 s, left about 26 min 00 s, ends about 14:31",
    "IA: 1566 of 5500 samples",
    "▶ now   S4 Record N samples of the gyro, and the field",
    "✔ clear: ",
    "! true for a moment: coil-x-current (3.4 A is above 3.35 A)",
    "gyro_acquisition rate: 9.662 deg/h, from 9.56 deg/h to 9.72 deg/h so far",
    *(set_ for _, set_, _ in READ),
    *(f"{key} {text}" for _, _, read in READ for key, text in read.items() if key != "output"),
)

IN_CHINESE = (
    "状态 ▶ 进行中 被测件 RLG-50 SN-0042",
    "第 2 个工作单元，共 4 个",
    "已用 18 min 00 s，约剩 26 min 00 s，约于 14:31 结束",
    "当前 IA：已采 1566 / 5500 个",
    "▶ 当前 S4 采集 N 个陀螺数据及磁场",
    "仪器 设定值 回读值",
    "正弦 0.1 Hz，3.33 A，1 mT",
    "! 短暂触发：",
    "陀螺采集板角速率：9.662 deg/h，至今 9.56 deg/h 至 9.72 deg/h",
)


class File(StringIO):
    """What a terminal of an encoding is sent."""

    def __init__(self, encoding: str) -> None:
        super().__init__()
        self._encoding = encoding

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._encoding


def holds(text: str, part: str) -> bool:
    """Whether a text has the words of a part in their order: a narrow column folds them."""
    return re.search(".*?".join(map(re.escape, part.split())), text, re.DOTALL) is not None


def shown(picture: Picture, columns: int, rows: int, encoding: str = "utf-8") -> list[str]:
    file = File(encoding)
    console = Console(file=file, width=columns, height=rows, force_terminal=True, color_system=None)
    drawing = Drawing(console, columns, rows)
    console.print(drawing.frame(picture), end="")
    return file.getvalue().splitlines()


def picture(live: dict[str, Any] = LIVE, trace: Trace | None = TRACE, **state: Any) -> Picture:
    return Picture({**STATE, **state}, TIMES, NOW, live, trace)


@pytest.mark.parametrize(("columns", "rows"), [(80, 23), (100, 29), (130, 23), (200, 49)])
def test_every_part_is_on_the_screen_and_no_line_is_longer(columns: int, rows: int) -> None:
    lines = shown(picture(), columns, rows)
    text = "\n".join(lines)
    assert len(lines) <= rows
    assert max(map(len, lines)) <= columns
    for part in PARTS:
        assert holds(text, part), f"{part!r} is not in\n{text}"


def test_a_wide_screen_shows_every_step_beside_the_values() -> None:
    lines = shown(picture(), 200, 49)
    assert all(any(title in line for line in lines) for title in TITLES)
    assert any(TITLES[0] in line and "read back" in line for line in lines)


def test_a_very_wide_screen_is_used_over_its_whole_width_and_grows_no_higher() -> None:
    lines = shown(picture(), 200, 49)
    assert len(lines) < 25
    (first,) = (line for line in lines if TITLES[0] in line)
    assert re.search(r"4 min 30 s +instrument +set +read back +log$", first.rstrip())
    assert lines[-1].endswith("0:19:30  sentence 39 of the log")  # the newest is the last
    assert [line for line in lines if "sine 0.1 Hz, 3.33 A, 1 mT" in line]  # in one piece
    assert "log" not in "\n".join(shown(picture(log=[]), 200, 49))


@pytest.mark.parametrize("columns", [130, 140, 180, 240])
def test_steps_get_what_their_titles_need_and_values_the_rest(columns: int) -> None:
    lines = shown(picture(), columns, 49)
    assert max(map(len, lines)) <= columns
    (first,) = (line for line in lines if TITLES[0] in line)
    assert first.index("instrument") <= 81
    whole = [title for title in TITLES if any(title in line for line in lines)]
    assert columns < 140 or len(whole) == len(TITLES)
    (row,) = (line for line in lines if "current 2.774 A" in line)
    assert "output on" not in row  # each value has a line


def test_a_step_has_the_time_that_it_took_or_will_take() -> None:
    times = {"began_s": 10.0, "took_s": None, "expected_s": 90.0}
    assert step_time({**times, "took_s": 75.2}, 500.0) == "1 min 15 s"
    assert step_time(times, 40.0) == "~1 min 30 s"
    assert step_time(times, 200.0) == "~3 min 10 s"  # it takes longer than expected
    assert step_time({**times, "began_s": None}, 500.0) == "~1 min 30 s"
    assert step_time({**times, "took_s": 0.0}, 500.0) == ""
    assert step_time({**times, "began_s": None, "expected_s": None}, 500.0) == ""
    text = "\n".join(shown(picture(), 80, 40))
    assert holds(text, "S3 Drive coil X with a sine of frequency f and amplitude M 4 min 30 s")
    assert holds(text, "S5 Transform the record ~4 min 24 s")
    assert "min 30 s" not in "\n".join(shown(picture(), 60, 40))  # titles come first


@pytest.mark.parametrize("rows", range(8, 30))
def test_on_a_low_screen_what_is_left_out_is_counted(rows: int) -> None:
    lines = shown(picture(), 80, rows)
    assert len(lines) <= rows
    steps = [line for line in lines if line.startswith(("✔ done", "▶ now", "· waits"))]
    counted = [line for line in lines if line.startswith("…") and "after" in line]
    if rows >= 12:
        assert any("now   S4" in line for line in steps), lines
    if rows >= 12 and len(steps) < len(TITLES):
        assert counted, lines


def test_colour_is_never_alone_and_a_plain_terminal_gets_plain_marks() -> None:
    locks = [
        {"name": "chain", "state": "tripped", "said": "the chain is open"},
        {"name": "field", "state": "clear", "said": ""},
    ]
    text = "\n".join(shown(picture({**LIVE, "interlocks": locks}), 80, 23, "ascii"))
    assert "X TRIPPED: chain (the chain is open)" in text
    assert "+ done  S" in text
    assert "> now   S4" in text
    assert not set(text) & set("✔▶·…▁▂▃▄▅▆▇█")


def test_a_prompt_and_a_bench_that_is_not_safe_are_said() -> None:
    prompt = {"id": "mount", "text": "Mount the gyro."}
    safe = [
        {"instrument": "coil_supply.x", "verified": False},
        {"instrument": "coil_supply.y", "verified": True},
    ]
    text = "\n".join(shown(picture(prompt=prompt, safe=safe), 80, 23))
    assert "waits for an answer: Mount the gyro." in text
    assert "✘ NOT VERIFIED as safe: coil_supply.x" in text
    text = "\n".join(shown(picture(safe=safe[1:]), 80, 23))
    assert "✔ the bench is safe" in text
    assert "2.774 A" not in text  # what flowed before says nothing of a bench at rest


def test_a_pause_that_is_to_come_is_said() -> None:
    text = "\n".join(shown(picture({**LIVE, "pause_requested": True}), 80, 23))
    assert "IA: 1566 of 5500 samples; a pause comes after this unit of work" in text


def test_without_an_answer_of_the_run_there_is_still_a_picture() -> None:
    bare = Picture({**STATE, "steps": [], "dut": None, "units_planned": None}, TIMES, NOW)
    text = "\n".join(shown(bare, 80, 23))
    assert "device unknown" in text
    assert "IA is being recorded" in text
    assert "interlocks" not in text


def test_what_a_line_has_no_room_for_is_counted_and_old_values_have_an_age() -> None:
    read = [
        {"quantity": "output", "text": "off", "age_s": 600.0},
        {"quantity": "current", "text": "3.33 A", "age_s": 1.0},
    ]
    assert read_words(read, 80) == "current 3.33 A, output off (10 min ago)"
    assert read_words(read, 38) == "current 3.33 A, +1"
    assert [age_words(one) for one in (30.0, 45.0, 7300.0)] == ["", " (45 s ago)", " (2 h ago)"]
    assert read_words([], 10) == "-"


@pytest.mark.parametrize(
    ("after", "said"),
    [(600.0, "ends about 14:15"), (43200.0, "ends about Mon 02 Mar 02:05")],
)
def test_the_time_of_the_end_has_its_day_where_that_is_another(after: float, said: str) -> None:
    assert said in time_words(Times(0.0, after, NOW + timedelta(seconds=after)), NOW)
    assert "ends" not in time_words(Times(0.0, after, None), NOW)


def test_a_window_keeps_what_matters_within_its_room() -> None:
    assert window([1, 1, 1], 0, 3) == (0, 3)
    for focus in range(10):
        for room in range(2, 12):
            first, end = window([1] * 10, focus, room)
            assert first <= focus < end
            assert end - first + (end - first < 10) <= room
    assert window([3, 3, 3], 1, 4) == (1, 2)
    assert window([3, 3, 3], 1, 3) == (1, 1)


def test_a_sparkline_is_as_wide_as_its_values_or_its_place() -> None:
    assert sparkline([0.0, 1.0, 2.0], 10, "_-=") == "_-="
    assert sparkline([0.0, 0.0, 4.0, 4.0], 2, "_-=") == "_="
    assert sparkline([5.0, 5.0], 10, "_-=") == "--"
    assert sparkline([], 10, "_-=") == ""
    assert sparkline([99.0, *(0.0, 1.0, 2.0) * 20], 61, "_-=") == "=" + "_-=" * 20  # a glitch
    assert sparkline([99.0, *(0.0,) * 60], 61, "_-=") == "=" + "_" * 60


@pytest.mark.parametrize(("columns", "rows"), [(80, 23), (130, 23), (200, 49)])
def test_the_picture_is_in_the_language_of_the_terminal_and_its_columns_are_in_line(
    columns: int, rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(HERE, "language", "zh")
    lines = shown(picture(), columns, rows)
    text = "\n".join(lines)
    assert len(lines) <= rows
    assert max(map(cell_len, lines)) <= columns
    for part in IN_CHINESE:
        assert holds(text, part), part
    # Where the title of a step stands.
    steps = [line for line in lines if re.match(r"\S 完成 ", line)]
    assert len({cell_len(line[: line.index(" S")]) for line in steps}) == 1
    names = ("线圈电源 x", "高斯计", "温箱", "转台")
    for name, (_, set_, _) in zip(names, READ, strict=True):
        assert any(name in line for line in lines), (name, set_)
