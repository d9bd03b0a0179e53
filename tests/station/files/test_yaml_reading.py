"""YAML is read strictly, by version 1.2, and every fault has its line and column."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, ValidationInfo, field_validator

from station.fields import Hertz, Second, StrictModel, Unit, to_yaml_data
from station.files.validation import validate_model
from station.files.yaml.document import Where, yaml_text
from station.files.yaml.reading import FaultList, Mark, read_yaml, read_yaml_text

FILE = Path("plan.yaml")


def faults_of(text: str) -> list[str]:
    with pytest.raises(FaultList) as caught:
        read_yaml_text(text, FILE)
    assert caught.value.exit_code == 2
    return [str(fault) for fault in caught.value.faults]


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("1e-3", 1e-3),
        ("1E3", 1000.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("-3", -3),
        ("010", 10),
        ("0o10", 8),
        ("0x1F", 31),
        (".inf", math.inf),
        ("-.INF", -math.inf),
        ("true", True),
        ("False", False),
        ("~", None),
        ("null", None),
        ("", None),
        ("NO", "NO"),
        ("yes", "yes"),
        ("on", "on"),
        ("12:30:00", "12:30:00"),
        ("2027-01-31", "2027-01-31"),
        ("1_000", "1_000"),
        ("0b1", "0b1"),
        ("=", "="),
        ("0.5 mT", "0.5 mT"),
        ("it's", "it's"),
        ('"1"', "1"),
        ("'true'", "true"),
    ],
)
def test_a_word_means_what_yaml_1_2_says(word: str, value: object) -> None:
    read = read_yaml_text(f"key: {word}\n", FILE).data["key"]
    assert read == value
    assert type(read) is type(value)


def test_a_key_is_always_the_word_that_is_written() -> None:
    assert read_yaml_text("NO: 1\n010: 2\ny: 3\n", FILE).data == {"NO": 1, "010": 2, "y": 3}


WORDS = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,7}", fullmatch=True)
TEXTS = st.text(st.characters(exclude_categories=["C", "Z"], include_characters=" "), max_size=12)
SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(10**20), 10**20)
    | st.floats(allow_nan=False)
    | TEXTS
    | st.sampled_from(["NO", "1e-3", "0x1F", "~", ".inf", "12:30", "a: b", "# x", "- y", "'", '"'])
)
DATA = st.dictionaries(
    WORDS,
    st.recursive(
        SCALARS,
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
        max_leaves=12,
    ),
    max_size=5,
)


class Writer:
    """Write data as a person may, and note where each key and each value comes to stand."""

    def __init__(self, draw: st.DrawFn) -> None:
        self.draw = draw
        self.lines = [""]
        self.keys: dict[Where, Mark] = {}
        self.values: dict[Where, Mark] = {}

    def put(self, text: str) -> None:
        self.lines[-1] += text

    def begin_line(self, indent: int) -> None:
        for _ in range(self.draw(st.integers(0, 1))):
            self.lines.append("# a remark: with [anything] in it")
        self.lines.append(" " * indent)

    def mark(self) -> Mark:
        return Mark(len(self.lines), len(self.lines[-1]) + 1)

    def block(self, value: Any, where: Where, indent: int) -> None:
        """Write what stands at `where`; its first line is begun."""
        self.values[where] = self.mark()
        if isinstance(value, dict) and value:
            for number, (key, inner) in enumerate(value.items()):
                if number:
                    self.begin_line(indent)
                self.key(key, where)
                if inner and isinstance(inner, dict | list) and self.draw(st.booleans()):
                    deeper = indent + self.draw(st.integers(1, 4))
                    self.begin_line(deeper)
                    self.block(inner, (*where, key), deeper)
                else:
                    self.put(" ")
                    self.flow(inner, (*where, key))
        elif isinstance(value, list) and value:
            for number, inner in enumerate(value):
                if number:
                    self.begin_line(indent)
                self.put("- ")
                self.block(inner, (*where, number), indent + 2)
        else:
            self.flow(value, where)

    def flow(self, value: Any, where: Where) -> None:
        self.put(" " * self.draw(st.integers(0, 2)))
        self.values[where] = self.mark()
        if isinstance(value, dict):
            self.put("{")
            for number, (key, inner) in enumerate(value.items()):
                self.put(", " if number else "")
                self.key(key, where)
                self.put(" ")
                self.flow(inner, (*where, key))
            self.put("}")
        elif isinstance(value, list):
            self.put("[")
            for number, inner in enumerate(value):
                self.put(", " if number else "")
                self.flow(inner, (*where, number))
            self.put("]")
        elif isinstance(value, float) and math.isinf(value):
            self.put(".inf" if value > 0 else "-.inf")
        else:
            self.put(json.dumps(value, ensure_ascii=False))

    def key(self, key: str, where: Where) -> None:
        self.keys[*where, key] = self.mark()
        self.put(f"{key}:" if self.draw(st.booleans()) else f'"{key}":')


@given(DATA.filter(bool), st.data())
def test_every_key_and_value_keeps_its_line_and_column(
    data: dict[str, Any], drawn: st.DataObject
) -> None:
    writer = Writer(drawn.draw)
    writer.block(data, (), 0)
    document = read_yaml_text("\n".join(writer.lines) + "\n", FILE)
    assert document.data == data
    assert document.key_positions == writer.keys
    assert document.positions == writer.values


@given(DATA)
def test_data_that_are_written_are_read_again_unchanged(data: dict[str, Any]) -> None:
    read = read_yaml_text(yaml_text(data), FILE).data
    assert repr(read) == repr(data)  # 1 is not 1.0, and not True


@pytest.mark.parametrize(
    ("text", "place", "sentence"),
    [
        ("a: 1\nb: 2\na: 3\n", "3:1", "the key stands twice, first in line 1"),
        ("a: &x 1\n", "1:4", "'&x' is an anchor"),
        ("a: *x\n", "1:4", "'*x' is an alias"),
        ("a: !!str 1\n", "1:4", "'!!str' is a tag"),
        ("a: {<<: {b: 1}}\n", "1:5", "'<<' merges mappings"),
        ("a:\n\tb: 1\n", "2:1", "the indentation holds a tab"),
        ("a: [1,\t2]\n", "1:7", "the line holds a tab"),
        ("a：1\n", "1:2", "'：' is a full-width colon; write ':'"),
        ("a: [1，2]\n", "1:6", "'，' is a full-width comma; write ','"),
        ("a: 【1】\n", "1:4", "'【' is a full-width bracket"),
        ("a: “x”\n", "1:4", "'“' is a typographic quotation mark"),
        ("a:\u3000x\n", "1:3", "is an ideographic blank"),
        ("a: １\n", "1:4", "is a full-width digit; write '1'"),
        ("", "1:1", "the file is empty"),
        ("# only this\n", "1:1", "the file is empty"),
        ("- 1\n", "1:1", "must consist of 'key: value' lines"),
        ("a: [1, 2\nb: 3\n", "1:4", "a list in brackets is not closed"),
        ("a: 'x\nb: 1\n", "1:4", "a quoted text is not closed"),
        ("a:1\nb: 2\n", "2:2", "the line above lacks its ': '"),
        ("a:\n  - 1\n - 2\n", "3:2", "indented differently"),
        ("a: 1\n---\nb: 2\n", "2:1", "begins a second document"),
        ("a: @x\n", "1:4", "may not begin with this character"),
        ("? [a]\n: 1\n", "1:3", "a key must be a word"),
        ("a: \x01\n", "1:4", "may not stand in a text file"),
    ],
)
def test_a_mistake_in_the_text_is_explained_where_it_stands(
    text: str, place: str, sentence: str
) -> None:
    first = faults_of(text)[0]
    assert first.startswith(f"plan.yaml:{place}: ")
    assert sentence in first


def test_quotes_comments_and_block_text_may_hold_any_punctuation() -> None:
    text = "a: '高：压，“x”\t'  # 注意：here\nb: \"\\\"：\"\nc: |\n  x：\n  \ty\nd: it's # ：\n"
    data = read_yaml_text(text, FILE).data
    assert data == {"a": "高：压，“x”\t", "b": '"：', "c": "x：\n\ty\n", "d": "it's"}


def test_several_mistakes_are_reported_at_once() -> None:
    assert len(faults_of("a: &x 1\nb: *x\na: 2\nc: {<<: 1}\n")) == 4


def test_a_byte_order_mark_is_accepted_and_other_encodings_are_explained(tmp_path: Path) -> None:
    file = tmp_path / "plan.yaml"
    file.write_bytes("\ufeffa: 1\n".encode())
    assert read_yaml(file).data == {"a": 1}
    file.write_bytes("a: 1\nb: 25 °C\n".encode("latin-1"))
    with pytest.raises(FaultList, match=r"plan.yaml:2:7: file: byte 0xb0 is not UTF-8"):
        read_yaml(file)
    with pytest.raises(FaultList, match="the path does not exist"):
        read_yaml(tmp_path / "absent.yaml")
    with pytest.raises(FaultList, match="cannot be read"):
        read_yaml(tmp_path)


class Part(StrictModel):
    name: str
    slope_limit_deg_per_h2: Annotated[float, Unit("deg/h^2")] = 0.5
    rule: Literal["simple", "guarded"] = "simple"


class Averaged(StrictModel):
    kind: str
    averaging_s: Second | None = Field(default=None, validate_default=True)

    @field_validator("averaging_s")
    @classmethod
    def needed_for_a_mean(cls, averaging_s: float | None, info: ValidationInfo) -> float | None:
        if averaging_s is None and info.data.get("kind") == "mean":
            raise ValueError("a mean needs an averaging time")
        return averaging_s


class Whole(StrictModel):
    frequency_Hz: Hertz
    duration_s: Annotated[Second, Field(gt=0)]
    rise_degC: Annotated[float, Unit("degC", difference=True)] | None = None
    count: int = 1
    parts: tuple[Part, ...] = ()
    by_name: dict[str, Part] = Field(default_factory=dict)

    @field_validator("duration_s")
    @classmethod
    def whole_cycle(cls, duration_s: float, info: ValidationInfo) -> float:
        frequency_Hz = info.data.get("frequency_Hz")
        if frequency_Hz is not None and duration_s * frequency_Hz < 1:
            raise ValueError("is shorter than one cycle")
        return duration_s


def model_faults(text: str) -> list[str]:
    with pytest.raises(FaultList) as caught:
        validate_model(read_yaml_text(text, FILE), Whole)
    return [str(fault) for fault in caught.value.faults]


def test_the_key_of_a_quantity_is_its_attribute_without_the_unit() -> None:
    document = read_yaml_text(
        "frequency: 100 kHz\nduration: 2 min\nrise: 3 K\n"
        "parts: [{name: a, slope_limit: 1 deg/h^2}]",
        FILE,
    )
    whole = validate_model(document, Whole)
    assert (whole.frequency_Hz, whole.duration_s, whole.rise_degC) == (1e5, 120.0, 3.0)
    assert whole.parts[0].slope_limit_deg_per_h2 == 1.0


def test_an_attribute_that_hides_its_unit_is_refused_when_the_model_is_written() -> None:
    with pytest.raises(TypeError, match="end it _Hz"):

        class Wrong(StrictModel):
            frequency: Annotated[float, Unit("Hz")]


def test_a_model_is_written_back_with_units_and_read_again_unchanged() -> None:
    document = read_yaml_text(
        "frequency: 0.1 Hz\nduration: 20 s\nby_name: {NO: {name: '1e-3'}, b: {name: 'µ: x'}}", FILE
    )
    whole = validate_model(document, Whole)
    data = to_yaml_data(whole)
    assert data["frequency"] == "0.1 Hz"
    assert data["by_name"]["NO"]["slope_limit"] == "0.5 deg/h^2"
    assert validate_model(read_yaml_text(yaml_text(data), FILE), Whole) == whole


def test_every_fault_of_a_model_is_reported_at_once_with_line_and_column() -> None:
    faults = model_faults(
        "frequency: 0.1 hz\n"
        "count: '3'\n"
        "durration: 5 s\n"
        "parts:\n"
        "  - {name: 7, rule: guraded}\n"
        "  - {slope_limit: 3}\n"
        "by_name: {a: {nam: x, name: y}, b: 3}\n"
    )
    assert faults == [
        "plan.yaml:1:1: duration: is missing",
        "plan.yaml:1:12: frequency: '0.1 hz' has a unit that is not known, 'hz', expected a "
        "frequency such as '0.1 Hz'; did you mean '0.1 Hz'",
        "plan.yaml:2:8: count: must be a whole number, not '3'",
        "plan.yaml:3:1: durration: is not known here; did you mean 'duration'",
        'plan.yaml:5:12: parts[1].name: must be text, not 7; did you mean "7"',
        "plan.yaml:5:21: parts[1].rule: must be 'simple' or 'guarded', not 'guraded'; did you "
        "mean 'guarded'",
        "plan.yaml:6:5: parts[2].name: is missing",
        "plan.yaml:6:19: parts[2].slope_limit: 3 has no unit, expected a drift of rate such as "
        "'0.02 deg/h^2'; did you mean '3 deg/h^2'",
        "plan.yaml:7:15: by_name.a.nam: is not known here; did you mean 'name'",
        "plan.yaml:7:36: by_name.b: must be a mapping, not 3",
    ]


def test_a_rule_that_joins_fields_is_reported_together_with_other_faults() -> None:
    faults = model_faults("frequency: 0.1 Hz\nduration: 5 s\ncount: 1.5\n")
    assert faults == [
        "plan.yaml:2:11: duration: is shorter than one cycle",
        "plan.yaml:3:8: count: must be a whole number, not 1.5",
    ]


def test_a_default_that_a_rule_refuses_is_reported_under_its_key() -> None:
    document = read_yaml_text("x: 1\nin: {kind: mean}\n", FILE)
    with pytest.raises(FaultList) as caught:
        validate_model(document, Averaged, at=("in",))
    assert str(caught.value) == "plan.yaml:2:5: in.averaging: a mean needs an averaging time"


class Either(StrictModel):
    at: dict[str, int | Part]


def test_a_mapping_where_a_number_would_do_has_the_faults_inside_it() -> None:
    def told(text: str) -> list[str]:
        with pytest.raises(FaultList) as caught:
            validate_model(read_yaml_text(text, FILE), Either)
        return [str(fault).partition(": ")[2] for fault in caught.value.faults]

    (unknown,) = told("at: {one: 1, two: {name: x, colour: red}}\n")
    assert unknown.startswith("at.two.colour: is not known here; known are name")
    assert told("at: {one: 1, two: {}}\n") == ["at.two.name: is missing"]
    assert told("at: {one: x}\n") == ["at.one: must be a whole number, not 'x'"]


def test_a_part_of_a_document_is_held_against_its_own_model() -> None:
    document = read_yaml_text("inside:\n  deep: {name: x, rule: guarded}\n", FILE)
    assert validate_model(document, Part, at=("inside", "deep")).rule == "guarded"
    with pytest.raises(FaultList, match=r"plan.yaml:1:1: absent.name: is missing"):
        validate_model(document, Part, at=("absent",))
