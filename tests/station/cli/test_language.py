"""The terminal in another language: people read it there, programs and records stay as they are."""

from __future__ import annotations

import json
import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from command_line import PLAN, station, station_command
from terminal import OnTerminal

from station.cli.attaching import in_english
from station.control.status import read_status
from station.record.events import LogTail
from station.record.folder import RESULTS
from station.record.layout import EVENTS, RAW
from station.speech import ENGLISH, HERE, answered, of_environment, padded, said
from station.texts import TERMINAL, Texts, catalogue, is_sound, languages

IDEOGRAPH = re.compile("[\u4e00-\u9fff]")
CHINESE = {"LC_ALL": "", "LC_MESSAGES": "", "LANG": "zh_CN.UTF-8"}
PLAIN = {"LC_ALL": "", "LC_MESSAGES": "", "LANG": "C.UTF-8"}
OF_ITS_TIME = re.compile(r"\d{4}-\d\d-\d\dT[\d:.+]+|[0-9a-f]{64}")
"""A time of day, or the check sum of a file that holds one."""


@pytest.fixture
def in_chinese(monkeypatch: pytest.MonkeyPatch) -> None:
    """This process speaks Chinese."""
    monkeypatch.setattr(HERE, "language", "zh")


@pytest.mark.parametrize(
    ("settings", "language"),
    [
        ({}, "en"),
        ({"LANG": "zh_CN.UTF-8"}, "zh"),
        ({"LANG": "zh_CN.UTF-8", "LC_ALL": "C"}, "en"),
        ({"LANG": "en_GB.UTF-8", "LC_MESSAGES": "zh_CN"}, "zh"),
        ({"LANG": "C", "LC_ALL": "", "LC_MESSAGES": ""}, "en"),
        ({"LANG": "xx_YY.UTF-8"}, "en"),
    ],
)
def test_the_computer_says_which_language_is_spoken(
    settings: dict[str, str], language: str
) -> None:
    assert of_environment(settings) == language


def test_each_translation_of_the_terminal_holds_the_values_of_its_sentence() -> None:
    for language in languages()[1:]:
        texts = catalogue(language, TERMINAL)
        assert [text for text, other in texts.items() if not is_sound(text, other)] == []


@pytest.mark.usefixtures("in_chinese")
def test_columns_stay_where_they_are_though_a_chinese_sign_is_twice_as_wide() -> None:
    assert said("12:00:00  S1  Draw the spectrum 2|X|/N against k/T") == (
        "12:00:00  S1  绘制 2|X|/N 对 k/T 的频谱"
    )
    assert said("state           S1  unknown") == "状态            S1  未知"
    assert padded("state", 16) == "状态" + 12 * " "
    assert said("  none\nwritten: a b.html") == "  无\n已写入：a b.html"


@pytest.mark.usefixtures("in_chinese")
@pytest.mark.parametrize(
    ("typed", "recorded"),
    [
        ("完成\n", "done"),
        (" 中止！", "abort"),
        ("done\n", "done\n"),
        ("\n", "\n"),
        ("5 mT", "5 mT"),
    ],
)
def test_a_word_of_the_language_is_recorded_as_the_english_one(typed: str, recorded: str) -> None:
    assert answered(typed) == recorded


def test_the_process_of_a_run_speaks_english_to_whoever_shows_it() -> None:
    for arguments in (["--lang", "zh", "run", "p"], ["run", "p", "--lang=zh"], ["run", "p"]):
        assert in_english(arguments) == ["--lang", ENGLISH, "run", "p"]


@pytest.mark.parametrize(
    ("encoding", "chinese"), [("utf-8", True), ("gb18030", True), ("ascii", False)]
)
def test_a_terminal_whose_encoding_has_no_chinese_is_spoken_to_in_english(
    encoding: str, chinese: bool, tmp_path: Path
) -> None:
    where = {**os.environ, **CHINESE, "PYTHONIOENCODING": encoding}
    done = subprocess.run(
        station_command("run", "nix"), cwd=tmp_path, env=where, capture_output=True, check=False
    )
    assert bool(IDEOGRAPH.search(done.stderr.decode(encoding))) == chinese
    assert b"\\u" not in done.stderr


def test_a_misspelt_plan_is_refused_in_chinese_and_its_document_stays_english(
    tmp_path: Path,
) -> None:
    refused = station(tmp_path, "run", "rlg-magnetik", **CHINESE)
    assert refused.returncode == 2
    assert refused.stderr.startswith(
        "rlg-magnetik:1:1: file: 没有这样的测试方案，既无此文件也无此名称；"
        "您是否指 'rlg-magnetic-sensitivity'；现有 "
    )
    wrong = station(tmp_path, "run", "--colour", **CHINESE)
    assert wrong.returncode == 2 and "错误：没有选项 --colour" in wrong.stderr
    assert "choose --lang en, zh" in station(tmp_path, "list", "--lang", "xx", **PLAIN).stderr
    english = station(tmp_path, "run", "rlg-magnetik", "--lang", "en", **CHINESE)
    assert english.stderr == station(tmp_path, "run", "rlg-magnetik", **PLAIN).stderr


@pytest.mark.parametrize(
    "verb",
    [
        ("validate", "rlg-magnetik", "--json"),
        ("list", "plans", "--json"),
        ("run", "nix", "--json"),
        ("schema", "plan"),
        ("run", "--help"),
    ],
    ids=" ".join,
)
def test_what_programs_read_is_the_same_in_every_language(
    verb: tuple[str, ...], tmp_path: Path
) -> None:
    first, second = (station(tmp_path, *verb, **where) for where in (PLAIN, CHINESE))
    assert first.stdout == second.stdout != ""
    assert first.returncode == second.returncode


def events(run: Path) -> list[Any]:
    """Return what a run's log holds but times of day and check sums."""
    lines = OF_ITS_TIME.sub("", (run / EVENTS).read_text(encoding="utf-8")).splitlines()
    return [json.loads(line) for line in lines]


def test_a_run_is_shown_in_chinese_and_no_byte_that_it_measures_is_another(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    runs = []
    for name, where, options in (("en", PLAIN, ()), ("zh", CHINESE, ("--lang", "zh"))):
        done = station(
            tmp_path, "run", "plan.yaml", "--non-interactive", "--output", name, *options, **where
        )
        assert done.returncode == 0, done.stderr
        assert bool(IDEOGRAPH.search(done.stdout)) == (name == "zh")
        runs.append(next((tmp_path / name).iterdir()))
    english, chinese = runs
    assert "判定：合格" in done.stdout and "S1  将陀螺安装在线圈中心" in done.stderr
    assert "测试台安全，凡可能造成危害的仪器均已回读" in done.stderr
    files = [RESULTS, "plots.json", *(f"{RAW}/{path.name}" for path in (english / RAW).iterdir())]
    assert len(files) > 3
    for name in files:
        assert (english / name).read_bytes() == (chinese / name).read_bytes(), name
    assert events(english) == events(chinese)
    for path in (
        path for suffix in ("json*", "html", "csv") for path in chinese.rglob(f"*.{suffix}")
    ):
        assert not IDEOGRAPH.search(path.read_text(encoding="utf-8")), path


def test_a_prompt_that_is_answered_in_chinese_is_recorded_in_english(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    terminal = OnTerminal(tmp_path, "--lang", "zh", "run", "plan.yaml", "--rehearse")
    terminal.wait_for("[mount] 按回车或键入 `done`（完成）继续")
    terminal.type("也许\n")
    terminal.wait_for("'也许' 不是此处的有效应答")
    terminal.type("完成\n")
    terminal.wait_for("[connect-cables]")
    terminal.type("中止\n")
    assert terminal.ended() == 4
    terminal.wait_for("结束测试")
    (run,) = (tmp_path / "runs").iterdir()
    answers = [event.details for event in LogTail(run).new_events() if event.kind == "prompt"]
    assert [(one["answer"], one["by"]) for one in answers] == [("done", "operator")]
    assert read_status(run).bench_safe
    assert not IDEOGRAPH.search((run / EVENTS).read_text(encoding="utf-8"))


def test_a_blank_stands_between_a_latin_name_and_the_chinese_beside_it() -> None:
    current = "coil_supply.y current is 8.3 A, above 8.2 A (for 0.4 s)"
    trip = f"the interlock coil-y-current tripped at 120.4 s: {current}"
    reading = "线圈电源 y 电流为 8.3 A，高于 8.2 A（已持续 0.4 s）"
    assert Texts("zh")(trip) == f"联锁“线圈 y 电流”在 120.4 s 时动作：{reading}"
    chain = "the interlock chain tripped at 3.000 s: interlock_chain chain is open (open: door)"
    card = f"{chain}; `station acknowledge sim`"
    assert Texts("zh")(card) == (
        "联锁“联锁链”在 3.000 s 时动作：联锁链断开（断开的触点：门）；`station acknowledge sim`"
    )
