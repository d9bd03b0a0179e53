"""The reference pages are whole, links lead somewhere, and every code block is an example."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import pytest
from docs_examples import ROOT, commands_of, examples, same

from station import registry
from station.dataset_reading import DatasetHeader
from station.files.lookup import BENCHES, find
from station.files.plan import read_plan
from station.files.plan.model import PlanHeader
from station.instruments.bench import bench_file, read_bench
from station.procedure import Procedures
from station.record.folder import RunFolder
from station.roles.sources import rows_of, section
from station.runner.execute import Request, execute
from station.runner.outcome import Outcome

DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "from_code"))

import meanings  # noqa: E402
import reference_bad_input  # noqa: E402
import reference_formats  # noqa: E402
import reference_instruments  # noqa: E402
import reference_keys  # noqa: E402
import simulated  # noqa: E402
import tables  # noqa: E402

PAGES = sorted(path for path in DOCS.rglob("*.md") if "_build" not in path.relative_to(DOCS).parts)
LINK = re.compile(r"\]\((?!#)([^)\s]+)\)")
SHORT = """\
plan: 1
procedure: rlg-magnetic-sensitivity
dut: {model: RLG-50, serial: D-1}
parameters:
  frequency: 0.2 Hz
  amplitude: 1 mT
  sample_interval: 0.1 s
  duration: 50 s
  axes: [IA]
  pulse_weight: 0.0625 arcsec
  warm_up: {slope_limit: 10 deg/h^2, window: 1 min, at_most: 5 min}
"""


def name_of(path: Path) -> str:
    return path.relative_to(DOCS).with_suffix("").as_posix()


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_code_block_that_looks_like_an_example_is_one(page: Path) -> None:
    """YAML, Python and TOML blocks are all carried out; text and JSON only show something."""
    blocks = re.findall(r"^```(\w+)\n", page.read_text(encoding="utf-8"), re.MULTILINE)
    shown = [language for language in blocks if language in {"yaml", "python", "toml"}]
    marked = [one for one in examples(page) if one.language in {"yaml", "python", "toml"}]
    assert len(shown) == len(marked)


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda path: path.name)
def test_links_lead_to_files_of_this_repository(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        path, _, _ = target.partition("#")
        assert not path.startswith("http"), f"{page.name} needs {path}"
        assert (page.parent / path).exists(), f"{page.name} links to {path}"


def test_the_plan_of_the_readme_has_no_fault(tmp_path: Path) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"^```yaml\n(.*?)^```", readme, re.MULTILINE | re.DOTALL)
    (tmp_path / "plan.yaml").write_text(text, encoding="utf-8")
    assert read_plan(tmp_path / "plan.yaml", Procedures()).procedure


def test_the_image_of_the_readme_is_there_and_small() -> None:
    image = DOCS / "images" / "spectrum.png"
    assert image.read_bytes().startswith(b"\x89PNG")
    assert image.stat().st_size < 150_000


def test_every_yaml_key_is_explained() -> None:
    pairs = [
        (PlanHeader, meanings.PLAN),
        (bench_file(), meanings.BENCH),
        (DatasetHeader, meanings.DATASET),
    ]
    for procedure in reference_keys.built_in():
        pairs.append((procedure.parameters, meanings.PARAMETERS.get(procedure.name, {})))
        if procedure.conditions is not None:
            pairs.append((procedure.conditions(), meanings.CONDITIONS.get(procedure.name, {})))
    for model, said in pairs:
        keys = {path: field.description for path, _, _, field in reference_keys.keys(model)}
        missing = {key for key, text in keys.items() if not (text or said.get(key))}
        assert not missing, f"say in docs/from_code/meanings.py what they mean: {missing}"
        assert not set(said) - set(keys), f"{model} has no such keys any more"


def test_every_flag_has_a_sentence() -> None:
    assert all(sentence for _, sentence in reference_formats.raised())
    assert "`simulated`" in reference_formats.flags()


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    folder = tmp_path_factory.mktemp("docs")
    (folder / "plan.yaml").write_text(SHORT, encoding="utf-8")
    plan = read_plan(folder / "plan.yaml", Procedures())
    bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
    return execute(Request(plan, bench, folder / "runs", quiet=True, trace=True))


def test_every_file_of_a_run_folder_is_explained(finished: Outcome) -> None:
    known = [
        re.escape(name).replace("SOURCE", r"\w+").replace("INSTRUMENT", r"[\w.]+")
        .replace("NNN", r"\d{3}").replace("AXIS", r"\w+").replace("RUN", r"[\w-]+")
        for name in reference_formats.RUN_FILES
    ]  # fmt: skip
    for path in finished.folder.rglob("*"):
        name = path.relative_to(finished.folder).as_posix()
        assert path.is_dir() or any(re.fullmatch(one, name) for one in known), name


def test_every_event_of_a_run_is_explained(finished: Outcome) -> None:
    kinds = {event.kind for event in RunFolder(finished.folder).events}
    written = r'\b(?:event|note|note_at)\(\s*(?:[\w.]+,\s*)?"([a-z-]+)"'
    for room in ("station", "drivers", "procedures"):
        for path in (ROOT / room).rglob("*.py"):
            kinds.update(re.findall(written, path.read_text(encoding="utf-8")))
    assert "switched-off-at-once" in kinds
    assert kinds - set(reference_formats.RUN_EVENTS) == set()


def test_every_key_of_the_result_document_is_explained(finished: Outcome) -> None:
    from station.cli.running import document_of

    document = document_of(finished, "rlg-magnetic-sensitivity")
    optional = {"count", "coefficients", "upper_bound"}
    found = {key for key in paths(document) if key.rpartition(".")[2] not in optional}
    assert found <= set(reference_formats.RESULT_KEYS) | limits_of(document)


def limits_of(document: object) -> set[str]:
    return {key for key in paths(document) if key.startswith("results[].limit.")}


def paths(data: object, before: str = "") -> set[str]:
    found: set[str] = set()
    if isinstance(data, dict):
        for key, value in data.items():
            path = f"{before}.{key}".removeprefix(".") + ("[]" if isinstance(value, list) else "")
            found |= {path} | paths(value, path)
    elif isinstance(data, list):
        for one in data:
            found |= paths(one, before)
    return found


def test_the_reference_pages_are_those_of_the_code() -> None:
    made = runpy.run_path(str(DOCS / "from_code" / "__main__.py"))
    for page in made["pages"]():
        text = page.read_text(encoding="utf-8")
        assert text == made["filled"](text), "run `python docs/from_code` and look at the change"


def test_the_table_of_bad_input_comes_from_its_tests() -> None:
    assert "did you mean" in reference_bad_input.bad_input()


def test_a_table_keeps_its_cells_apart() -> None:
    assert tables.table(("a", "b"), [("x|y", "two\nlines")]).splitlines() == [
        "| a | b |",
        "|---|---|",
        "| x\\|y | two lines |",
    ]


def test_what_a_page_prints_is_compared_line_by_line() -> None:
    assert same(["a … c", "…", "last"], ["a b c", "more", "and more", "last"])
    assert same(["…"], [])
    assert not same(["a", "b"], ["a"])
    assert not same(["a … c"], ["a b d"])
    assert commands_of("$ one\nx\n$ two\n") == [("one", "x\n"), ("two", "")]


@pytest.mark.parametrize("name", reference_instruments.own_drivers())
def test_every_driver_says_where_each_of_its_commands_is_documented(name: str) -> None:
    rows = rows_of(reference_instruments.own_drivers()[name])
    assert rows, "write its section"


def test_a_model_has_its_own_rows_and_not_those_of_one_beside_it() -> None:
    drivers = reference_instruments.own_drivers()
    card = {row.command for row in rows_of(drivers["kepco-bop-36-12"])}
    assert {"LIST:CURR:APPL SINE", "SYST:REM ON"}.isdisjoint(card)
    assert {"CURR:LIM", "FUNC:MODE CURR"} <= card
    thermometer = rows_of(drivers["keysight-34465a-pt100"])
    assert "VOLT:DC:IMP:AUTO" not in {row.command for row in thermometer}


NONSENSE = {
    "can": "NO_MESSAGE",
    "serial": "FE",
    "watlow": "60001",
    "kvh": "=NONSENSE",
    "acutrol": ":Nonsense:Rate? 1",
}


@pytest.mark.parametrize("name", reference_instruments.own_drivers())
def test_the_simulator_of_a_model_is_asked_for_each_row(name: str) -> None:
    row = rows_of(reference_instruments.own_drivers()[name])[0].command
    if simulated.simulator_of(name) is None:
        assert simulated.answered(name, row) == ""
        return
    other = NONSENSE.get(name.partition("-")[0], "NONS?")
    assert simulated.answered(name, row) == "yes"
    assert simulated.answered(name, other) == "no"
    assert simulated.answered(name, f"{row}, {other}") == f"not `{other}`"


def test_a_row_of_commands_may_go_on_and_has_four_parts() -> None:
    head = "Of a meter.\n\nCommands and their sources:\n    A? - ask\n        it - "
    rows = section(f"{head}manual - confirmed\n\nMore.\n", "Meter")
    assert list(rows) == [("A?", "ask it", "manual", "confirmed")]
    with pytest.raises(ValueError, match="Meter: 'A\\? - ask it - perhaps'"):
        list(section(f"{head}perhaps\n", "Meter"))
