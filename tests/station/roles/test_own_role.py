"""A laboratory's own role is one file of its package, and everything else follows from it."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_line import PLAN

from station import registry
from station.cli.validating import validate_plans
from station.errors import InputError
from station.files.faults import FaultList
from station.files.lookup import BENCHES, find
from station.files.yaml.reading import read_yaml_text
from station.instruments.bench import Bench, bench_file, bench_of
from station.method.dry_run import Forecast
from station.method.set_points import Bounded, Envelope, SetPoint
from station.roles.role import Limit, Quantity, Role, collected, kind_of, safe_states
from station.runner.static_limits import beyond_limits
from station.schema import schema_text

ROLE = '''\
"""The oven of a lamp."""

from typing import Protocol, runtime_checkable

from station.roles import Instrument, Limit, MadeSafe, Quantity, Role, SafeState


@runtime_checkable
class LampOven(Instrument, MadeSafe, Protocol):
    """An oven with its own controller."""

    def heat_to(self, temperature_degC: float) -> None:
        """Go to a temperature; returns at once."""
        ...


LAMP_OVEN = Role(
    "lamp_oven",
    LampOven,
    limits={"power": Limit("W", "largest power of the oven", needed=True)},
    quantities={"power": Quantity("W", period_s=2.0, limit="power")},
    safe_state=SafeState("no power at the oven", "the measured power", rank=35),
)
'''
DRIVER = '''\
"""A driver of the heater."""

from typing import ClassVar

from station.roles import Driver, SafetyReading


class Oven(Driver):
    quantities: ClassVar = {"power": lambda self: 0.0}

    def __init__(self, place): self.place = place
    def identify(self): return None
    def close(self): pass
    def make_safe(self, deadline_s): pass
    def read_safety(self): return SafetyReading(True, "0 W")
    def heat_to(self, temperature_degC): pass
'''
INSTRUMENT = """\
  lamp_oven:
    driver: lab-oven
    limits: {power: 10 W}
    simulator: {}
"""
INTERLOCK = """\
  - {name: oven, when: {instrument: lamp_oven, quantity: power, above: 12 W}}
"""
SAFE = "  - {role: lamp_oven, within: 5 s}\n"


def forget() -> None:
    """Have the registry, and what was made of it, look again."""
    for cached in (registry.offers, registry.names, collected, bench_file):
        cached.cache_clear()


@pytest.fixture
def laboratory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Have a package installed, in this process, that brings a role and a driver for it."""
    site = tmp_path / "site"
    info = site / "heaters-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: heaters\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(
        "[station.roles]\na-heater = heater_role:LAMP_OVEN\n"
        "[station.drivers]\nlab-oven = heater_driver:Oven\n"
        "[station.simulators]\nlab-oven = heater_driver:Oven\n",
        encoding="utf-8",
    )
    (site / "heater_role.py").write_text(ROLE, encoding="utf-8")
    (site / "heater_driver.py").write_text(DRIVER, encoding="utf-8")
    monkeypatch.syspath_prepend(str(site))
    forget()
    yield tmp_path
    forget()
    registry.load.cache_clear()
    for name in ("heater_role", "heater_driver"):
        sys.modules.pop(name, None)


def bench_text(instrument: str = INSTRUMENT, interlock: str = INTERLOCK, safe: str = SAFE) -> str:
    """Return the shipped bench with a heater."""
    text = find(BENCHES, "sim").read_text(encoding="utf-8")
    for key, more in (("instruments", instrument), ("interlocks", interlock), ("safe_state", safe)):
        text = text.replace(f"\n{key}:\n", f"\n{key}:\n{more}")
    return text


def read(text: str) -> Bench:
    document = read_yaml_text(text, Path("bench.yaml"))
    return bench_of(document, registry.names(registry.DRIVERS), bounded=True)


def faults_of(text: str) -> list[str]:
    with pytest.raises(FaultList) as caught:
        read(text)
    return [fault.what for fault in caught.value.faults]


def test_a_bench_may_have_it_with_its_limit_and_an_interlock_on_its_quantity(
    laboratory: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = read(bench_text())
    assert bench.instruments["lamp_oven"].limits == {"power": 10.0}
    (interlock,) = [one for one in bench.interlocks if one.name == "oven"]
    assert interlock.instruments == {"lamp_oven"}
    assert interlock.period_s == kind_of("lamp_oven", "power").period_s == 2.0
    assert ("lamp_oven", 5.0) in bench.safe_order()
    assert bench_of(bench.document, registry.names(registry.DRIVERS)).file == bench.file
    (laboratory / "plan.yaml").write_text(PLAN, encoding="utf-8")
    (laboratory / "bench.yaml").write_text(bench_text(), encoding="utf-8")
    assert validate_plans([str(laboratory / "plan.yaml")], str(laboratory / "bench.yaml")) == 0
    assert "1 plan without a fault" in capsys.readouterr().out


@pytest.mark.usefixtures("laboratory")
@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("limits: {power: 10 W}", "settings: {}", "is missing; a lamp_oven needs it"),
        ("10 W", "10 V", "'10 V' is a voltage, expected a power such as '50 W'"),
        ("10 W", "-10 W", "must be above 0, not '-10 W'"),
        ("above: 12 W", "above: 16 W", "so far beyond limits.power of lamp_oven, 10 W"),
        ("quantity: power", "quantity: watts", "is no quantity of a lamp_oven; it has power"),
        ("driver: lab-oven", "driver: operator-power", "cannot be a lamp_oven; it can be dut"),
        (
            "driver: lab-oven",
            "driver: interlock-chain-shared",
            "it shares no line; write shares:",
        ),
        (" W}\n    simulator: {}\n", " W}\n", "is missing; a simulated bench needs it, an empty"),
    ],
)
def test_what_is_wrong_with_it_is_refused_as_for_any_role(old: str, new: str, fault: str) -> None:
    text = bench_text()
    assert text.count(old) == 1
    assert any(fault in one for one in faults_of(text.replace(old, new)))


@pytest.mark.usefixtures("laboratory")
def test_a_driver_that_publishes_in_another_unit_than_its_role_is_refused(
    laboratory: Path,
) -> None:
    method = """
    @quantity("power", "mW")
    def power(self): return 1.0
"""
    text = DRIVER.replace("import Driver,", "import Driver, quantity,") + method
    text = text.replace('    quantities: ClassVar = {"power": lambda self: 0.0}\n', "")
    (laboratory / "site" / "heater_driver.py").write_text(text, encoding="utf-8")
    (fault,) = faults_of(bench_text())
    assert "publishes 'power' in mW, a lamp_oven has it in W" in fault


@pytest.mark.usefixtures("laboratory")
def test_it_is_in_the_schema_and_not_in_the_built_in_one() -> None:
    shown = json.loads(schema_text("bench"))
    assert "lamp_oven" not in schema_text("bench", built_in=True)
    instruments = shown["properties"]["instruments"]
    assert "lamp_oven" in instruments["propertyNames"]["enum"]
    power = instruments["additionalProperties"]["properties"]["limits"]["properties"]["power"]
    assert power["anyOf"][0]["description"] == "a power such as '50 W'; above 0 W"
    needs = instruments["allOf"][0]["patternProperties"][r"^lamp_oven(\.|$)"]
    assert needs["properties"]["limits"]["required"] == ["power"]
    when = shown["properties"]["interlocks"]["items"]["properties"]["when"]["anyOf"][0]
    assert "power" in when["properties"]["quantity"]["enum"]
    assert "lamp_oven" in shown["properties"]["safe_state"]["items"]["properties"]["role"]["enum"]


@pytest.mark.usefixtures("laboratory")
def test_what_a_step_commands_is_held_against_its_limit() -> None:
    bench = read(bench_text())
    within = SetPoint("1", "lamp_oven", "oven at 90 degC", limited={"power": 10.0})
    beyond = SetPoint("2", "lamp_oven", "oven at 150 degC", limited={"power": 12.0})
    assert list(beyond_limits(Forecast((within,)), bench)) == []
    (problem,) = beyond_limits(Forecast((within, beyond)), bench)
    assert problem.what == (
        "oven at 150 degC: 12 W is more than the 10 W that the bench allows for lamp_oven"
    )
    heat = Bounded("lamp_oven", "oven at 150 degC", within={"limited": {"power": 12.0}})
    Envelope.of([beyond]).require(heat, bench)
    with pytest.raises(InputError, match="beyond what its dry run saw"):
        Envelope.of([within]).require(heat, bench)


@pytest.mark.usefixtures("laboratory")
def test_its_rank_is_its_place_among_the_safe_states() -> None:
    order = list(safe_states())
    assert order.index("rotary_stage") < order.index("lamp_oven") < order.index("pump_laser")


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('"lamp_oven",', '"dut_power",', "there is a role 'dut_power' already"),
        (
            '"power": Limit("W"',
            '"voltage": Limit("mV", "", True), "power": Limit("W"',
            "its limit 'voltage' is in mV, that of a coil_supply in V",
        ),
        ('Limit("W"', 'Limit("horses"', "unit 'horses' is not known"),
        ('limit="power"', 'limit="pover"', "power names no limit of it"),
        ("LAMP_OVEN = Role(", "LAMP_OVEN = dict(role=", "cannot be loaded"),
    ],
)
def test_one_that_cannot_be_a_role_costs_itself_only_and_is_named(
    old: str, new: str, why: str, laboratory: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = laboratory / "site" / "heater_role.py"
    assert ROLE.count(old) == 1
    path.write_text(ROLE.replace(old, new), encoding="utf-8")
    (laboratory / "plan.yaml").write_text(PLAN, encoding="utf-8")
    assert validate_plans([str(laboratory / "plan.yaml")], "sim") == 0
    warning = capsys.readouterr().err
    assert warning.startswith("WARNING: the role ")
    assert why in warning


def test_a_declaration_says_what_is_wrong_with_it() -> None:
    with pytest.raises(ValueError, match="'zero current' is no name such as zero_current"):
        Role("lamp", Role, limits={"zero current": Limit("A", "")})
    with pytest.raises(ValueError, match="is no Protocol"):
        Role("lamp", "Lamp")  # type: ignore[arg-type]
    assert Quantity(states=("on", "off")).unit == ""
