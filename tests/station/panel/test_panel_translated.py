"""What a run says on the panel in another language; English, and what is recorded, stays as is."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from panel_server import Served, panel

from station import registry, texts
from station.cli.validating import read_bench_named, read_plan_for
from station.control.run_reader import RunReader
from station.files.faults import FaultList
from station.files.lookup import PLANS, available
from station.files.plan.composition import identifying
from station.method.prompts import Prompt
from station.panel import translating
from station.panel.watching import SAID as IN_NEWS
from station.panel.watching import RunWatch
from station.procedure import procedure_of
from station.record.events import SAID, EventLog
from station.record.run_state import SENTENCES
from station.texts import (
    ENGLISH,
    FAULTS,
    PANEL,
    RUN,
    TERMINAL,
    Texts,
    catalogue,
    is_sound,
    languages,
    of_packages,
)

IDEOGRAPH = re.compile("[\u4e00-\u9fff]")
NO_WORDS = re.compile(r"[-+0-9.]+ deg/s")
BENCHES = ("sim", "sim-alternate")
SHIPPED = [name for name, _ in available(PLANS)]
CHINESE = Texts("zh")
MOUNT = Prompt(
    "mount",
    "Mount the gyro on the turntable with care.",
    checklist=("Nobody is within reach of the table.",),
    then="the table turns",
)


def spoken(plan: str) -> Iterator[str]:
    """Yield what a walk of a shipped plan says to a person, on every bench that can run it."""
    for name in BENCHES:
        bench = read_bench_named(name)
        try:
            read = read_plan_for(plan, bench, identifying("SN-1", None))
        except FaultList:
            continue
        procedure = procedure_of(read.procedure)
        walk = procedure.walk(read.parameters)
        yield read.header.title or ""
        yield from (step.title for step in procedure.steps)
        for prompt in walk.prompts:
            yield from (prompt.text, *prompt.checklist, prompt.then)
            yield prompt.value.name if prompt.value else ""
        yield from (point.text for point in walk.set_points(bench))


def untranslated(said: set[str]) -> list[str]:
    return sorted(
        text
        for text in said
        if text and not NO_WORDS.fullmatch(text) and not IDEOGRAPH.search(CHINESE(text))
    )


@pytest.mark.parametrize("plan", SHIPPED)
def test_nothing_that_a_shipped_plan_says_is_left_in_english(plan: str) -> None:
    said = set(spoken(plan))
    assert said and untranslated(said) == []
    assert {text for text in said if Texts(ENGLISH)(text) != text} == set()


def test_no_event_state_or_prompt_of_a_driver_is_left_in_english() -> None:
    asked = {
        text
        for name in registry.names(registry.DRIVERS)
        for text in getattr(registry.load(registry.DRIVERS, name), "prompts", {}).values()
    }
    assert asked and untranslated({*SAID.values(), *SENTENCES.values(), *asked}) == []


def test_a_translation_shows_the_values_of_its_sentence() -> None:
    own = {**catalogue("zh", RUN), **catalogue("zh", FAULTS), **catalogue("zh", TERMINAL)}
    assert all(is_sound(english, other) for english, other in own.items())
    for file in Path().glob("[dp]r*/*/texts/*.json"):
        stated = json.loads(file.read_text(encoding="utf-8"))
        assert stated.items() <= dict(of_packages(file.stem)).items(), file


@pytest.mark.parametrize(
    ("english", "chinese"),
    [
        ("io 30 deg -45 mT 1 is being recorded", "正在记录：io 30 deg -45 mT 1"),
        ("probe x-plus, coil y minus is recorded", "已记录：探头位于 x 正向，线圈 y 反向"),
        ("S9 began: Switch the coils and the gyro off", "S9 开始：线圈和陀螺断电"),
        ("dut_power is operator", "被测件电源由操作员操作"),
        ("0, 10, 20 mT, up to 10 A", "0, 10, 20 mT，最大 10 A"),
        ("turntable rate is 5 deg/s, above 3 deg/s", "转台角速率为 5 deg/s，高于 3 deg/s"),
        ("NOT VERIFIED as safe: coil_supply.x, gaussmeter", "未核实为安全：线圈电源 x、高斯计"),
        ("channel 1 off, channel 2 off", "通道 1 关断、通道 2 关断"),
        (
            "coil_supply.x: record IA: no sample came for 10 s; switch it off by hand",
            "线圈电源 x：记录 IA：10 s 内没有采样；请手动关断",
        ),
        ("plane io is op, or if plane op is io", "平面 io 实为 op，或平面 op 实为 io"),
        (
            "Alone: Ki and Km. Only together: K0 + 2e-05 Kmm.",
            "可单独确定：Ki, Km。只能合并确定：K0 + 2e-05 Kmm。",
        ),
        (
            "/lab/plan.yaml:13:3: parameters.current: is not known here; did you mean 'currents'",
            "/lab/plan.yaml:13:3: parameters.current: 此处无此项；您是否指 'currents'",
        ),
        (
            "b.yaml:9:1: limits: must be a mapping of current, voltage",
            "b.yaml:9:1: limits: 应为含 current, voltage 的键值对",
        ),
        (
            "coil_supply.x: sent '*IDN?': no answer came within 0.5 s; check its cradle",
            "线圈电源 x：发送 '*IDN?'：0.5 s 内无应答；check its cradle",
        ),
        ("b.yaml:9:1: limits: the sun is hot", "b.yaml:9:1: limits: the sun is hot"),
        ("position of the sun", "position of the sun"),
        ("field, moon", "field, moon"),
        ("the gyro is not bolted, it is loose", "the gyro is not bolted, it is loose"),
        ("temperature is too high now", "temperature is too high now"),
        ("the sun is out: it will be a fine day", "the sun is out: it will be a fine day"),
    ],
)
def test_a_sentence_of_a_run_is_translated_with_its_values(english: str, chinese: str) -> None:
    assert CHINESE(english) == chinese


@pytest.mark.parametrize("text", ["coil x is " * 200, "a.yaml:1:1: " * 160, "a; b, c and " * 160])
def test_a_text_of_many_sentences_within_one_another_ends_no_viewer(text: str) -> None:
    assert CHINESE(text)


def test_a_catalogue_of_a_laboratory_counts_and_a_bad_one_costs_itself_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "texts"
    folder.mkdir()
    monkeypatch.setattr(registry, "names", lambda _: ("ours",))
    monkeypatch.setattr(registry, "folder_of", lambda *_: tmp_path)
    assert dict(of_packages("zh")) == {}
    for bad in ("[1]", "{", '{"a {n}": "b", "{n} and {n}": "{n} {n}", "{n}": "{n}", "c": 5}'):
        (folder / "zh.json").write_text(bad, encoding="utf-8")
        assert dict(of_packages("zh")) == {}
    (folder / "zh.json").write_text('{"Turn {n} knobs.": "旋 {n} 个旋钮。"}', encoding="utf-8")
    texts.whole.cache_clear()
    texts.translator.cache_clear()
    try:
        assert CHINESE("Turn 3 knobs.") == "旋 3 个旋钮。"
    finally:
        texts.whole.cache_clear()
        texts.translator.cache_clear()


def a_run(folder: Path) -> Path:
    """Write the log of a run that waits for an answer."""
    folder.mkdir(parents=True)
    step = {"step": "S9", "title": "Switch the coils and the gyro off", "expected_s": 60.0}
    log = EventLog(folder / "events.jsonl")
    log.append(0.0, "run-started", {"speed": 1.0, "steps": [step]}, durable=False)
    log.append(1.0, "step-started", step, durable=False)
    log.append(2.0, "prompt-shown", MOUNT.to_data(), durable=False)
    log.close()
    return folder


def test_viewers_of_a_language_share_its_texts_and_english_is_what_the_reader_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("station.control.run_reader.is_held", lambda _: True)
    folder = a_run(tmp_path / "run")
    log, made = (folder / "events.jsonl").read_bytes(), []
    translated = translating.translated

    def counted(data: object, *rest: object) -> object:
        made.append(data)
        return translated(data, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr("station.panel.watching.translated", counted)
    watch = RunWatch(folder)
    english = dict(watch.news({}))
    watch._looked_s = float("inf")  # nothing is read again: what follows is of one version
    chinese, again = (dict(watch.news({}, CHINESE)) for _ in range(2))
    assert chinese == again and len(made) == len(IN_NEWS.keys() & chinese.keys())
    assert dict(watch.news({})) == english
    reader = RunReader(folder)
    reader.read()
    own, stated = reader.state(), json.loads(english["state"])
    assert json.dumps({**own, "time_s": 0, "left_s": 0}) == json.dumps(
        {name: 0 if name in ("time_s", "left_s") else stated[name] for name in own}
    )
    state = json.loads(chinese["state"])
    assert state["steps"][0]["title"] == "线圈和陀螺断电"
    assert state["prompt"]["checklist"] == ["转台转动范围内无人。"]
    assert state["prompt"]["then"] == "转台转动" and state["prompt"]["id"] == "mount"
    assert all(IDEOGRAPH.search(line["text"]) for line in state["log"])
    assert state["state"] == stated["state"] == "running"
    assert (folder / "events.jsonl").read_bytes() == log


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    runs = tmp_path_factory.mktemp("panel")
    a_run(runs / "20260101T000000Z-a-b")
    with panel(runs) as one:
        yield one


def test_plans_looks_and_refusals_come_in_the_language_of_the_browser(served: Served) -> None:
    both = {
        language: {"Cookie": f"station-language={language}", "Accept-Language": "en"}
        for language in languages()
    }
    wanted = {"plan": "rlg-magnetic-sensitivity", "bench": "sim", "serial": "1", "operator": "a"}
    for language, title in (("en", "Acceptance test, three axes"), ("zh", "验收测试，三轴")):
        home = json.loads(served.get("/api/home", **both[language])[1])
        assert title in [plan["title"] for plan in home["plans"]]
        assert wanted["plan"] in [plan["name"] for plan in home["plans"]]
        _, text = served.post("/api/look", {**wanted, "serial": " "}, **both[language])
        assert bool(IDEOGRAPH.search(json.loads(text)["error"])) == (language == "zh")
    looked = json.loads(served.post("/api/look", wanted, **both["zh"])[1])
    assert all(IDEOGRAPH.search(step["title"]) for step in looked["steps"])
    shown = [point["text"] for step in looked["steps"] for point in step["set_points"]]
    assert shown and all(IDEOGRAPH.search(text) for text in shown)
    assert all(IDEOGRAPH.search(one["which"] + one["quantity"]) for one in looked["extremes"])


def test_the_rooms_of_the_station_say_the_same_of_a_state() -> None:
    for sentence in SENTENCES.values():
        assert catalogue("zh", PANEL)[sentence] == catalogue("zh", RUN)[sentence]
