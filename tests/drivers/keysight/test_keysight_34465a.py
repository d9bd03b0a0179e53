"""Our drivers of the 34465A, as multimeter and as thermometer, over the real transport."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import yaml
from fixture import EmptyRoom, Fixture
from keysight_fixture import OHMS, Room, burst, standing

from drivers.keysight.multimeter_34465a import Keysight34465A, Keysight34465APt100, temperature_degC
from station.errors import InstrumentError
from station.instruments.scan import draft, recognised


@pytest.fixture
def fixture() -> Iterator[Fixture]:
    with standing() as fixture:
        yield fixture


# The multimeter's driver.


def test_it_takes_all_errors_that_are_kept_and_leaves_none(fixture: Fixture) -> None:
    meter = Keysight34465A(fixture.place())
    for message in ("NONSENSE", "VOLT:RANG"):
        fixture.at_its_front_panel(message)
    assert [int(one.partition(",")[0]) for one in meter.take_errors()] == [-113, -109]
    assert meter.take_errors() == []
    meter.close()


def test_a_burst_longer_than_an_exchange_is_no_timeout() -> None:
    with standing(slope=1e-4) as fixture:
        meter = Keysight34465A(fixture.place())
        meter.configure(1.0, 100)
        block = burst(fixture, meter, 20)
        assert fixture.clock.now() > 20 * 4.0
        assert (np.diff(block.columns["voltage_V"]) > 0).all()
        meter.close()


def test_auto_zero_is_a_setting_of_the_bench(fixture: Fixture) -> None:
    meter = Keysight34465A(fixture.place(auto_zero=False))
    meter.configure(1.0, 10)
    assert fixture.at_its_front_panel("VOLT:ZERO:AUTO?") == "0"
    meter.close()


def test_what_somebody_left_in_the_meter_is_gone_after_the_first_configuration(
    fixture: Fixture,
) -> None:
    fixture.at_its_front_panel("TRIG:SOUR EXT;:SAMP:SOUR TIM;:VOLT:APER 1;:NONSENSE")
    meter = Keysight34465A(fixture.place())
    meter.configure(1.0, 10)
    assert len(burst(fixture, meter, 2)) == 2
    assert fixture.at_its_front_panel("VOLT:APER:ENAB?;:SAMP:SOUR?;:TRIG:SOUR?") == "0;IMM;IMM"
    meter.close()


def test_a_meter_that_waits_for_an_external_trigger_is_told(fixture: Fixture) -> None:
    meter = Keysight34465A(fixture.place())
    meter.configure(1.0, 10)
    meter.start(2)
    fixture.at_its_front_panel("TRIG:SOUR EXT;:INIT")
    with pytest.raises(InstrumentError, match=r"it has 0 and is not ready.*trigger is not set"):
        for _ in range(200):
            assert meter.fetch() is None
            fixture.clock.sleep(0.1)
    meter.close()


def test_a_step_and_an_interlock_share_the_meter(fixture: Fixture) -> None:
    meter = Keysight34465A(fixture.place())
    meter.configure(1.0, 10)
    seen: list[Any] = []

    def watch() -> None:
        for _ in range(20):
            seen.append(meter.read_quantity("voltage"))
            fixture.clock.sleep(0.37)

    watcher = fixture.clock.start("watch", watch)
    for _ in range(5):
        assert len(burst(fixture, meter, 4)) == 4
        fixture.clock.sleep(0.5)
    fixture.clock.sleep(20.0)
    watcher.join(5.0)
    assert len(seen) == 20 and set(seen) <= {0.5, None}
    meter.close()


def test_an_interlock_asks_again_before_it_believes_a_lost_answer() -> None:
    lost = {"fault": "no-reply", "command": "INIT"}
    with standing(faults=(lost,)) as fixture:
        meter = Keysight34465A(fixture.place())
        meter.configure(1.0, 1)
        assert meter.read_quantity("voltage") == 0.5
        meter.close()


def test_frozen_and_overloaded_inputs_can_be_simulated() -> None:
    with standing(
        slope=0.01, faults=({"fault": "overload", "at": "10 s", "for": "10 s"},)
    ) as fixture:
        meter = Keysight34465A(fixture.place())
        meter.configure(1.0, 1)
        assert not burst(fixture, meter, 1).columns["overload"].any()
        fixture.clock.sleep(12.0)
        assert burst(fixture, meter, 1).columns["overload"].all()
        meter.close()
    with standing(slope=0.01, faults=({"fault": "frozen", "at": "0 s"},)) as fixture:
        meter = Keysight34465A(fixture.place())
        meter.configure(1.0, 1)
        assert len(set(burst(fixture, meter, 5).columns["voltage_V"].tolist())) == 1
        meter.close()


# The thermometer's driver.


def callendar_van_dusen(at_degC: np.ndarray, r0_ohm: float) -> np.ndarray:
    """IEC 60751, written out once more."""
    above = 1 + 3.9083e-3 * at_degC - 5.775e-7 * at_degC**2
    below = -4.183e-12 * (at_degC - 100) * at_degC**3
    return r0_ohm * np.where(at_degC < 0, above + below, above)


@pytest.mark.parametrize("r0_ohm", [100.0, 1000.0])
def test_temperatures_follow_the_standard_on_both_sides_of_zero(r0_ohm: float) -> None:
    at_degC = np.concatenate([np.linspace(-200, 850, 2101), [-1e-6, 0.0, 1e-6]])
    found = temperature_degC(callendar_van_dusen(at_degC, r0_ohm), r0_ohm)
    assert np.abs(found - at_degC).max() < 1e-9


def test_values_of_the_tables_of_the_standard_come_back() -> None:
    ohms = np.array([18.52, 60.26, 80.31, 100.0, 119.40, 138.51, 390.48])
    found = temperature_degC(ohms, 100.0)
    assert found == pytest.approx([-200, -100, -50, 0, 50, 100, 850], abs=0.02)


@pytest.mark.parametrize(("ohms", "expected_degC"), [(107.7935, 20.0), (92.1599, -20.0)])
def test_a_burst_of_a_thermometer_gives_ohms_and_degrees(ohms: float, expected_degC: float) -> None:
    with standing(ohms=ohms, truth=OHMS) as fixture:
        thermometer = Keysight34465APt100(fixture.place())
        block = burst(fixture, thermometer, 3)
        assert list(block.columns) == list(thermometer.columns)
        assert block.columns["resistance_ohm"] == pytest.approx([ohms] * 3, abs=1e-6)
        assert block.columns["temperature_degC"] == pytest.approx([expected_degC] * 3, abs=1e-3)
        assert fixture.newest("temperature") == block.columns["temperature_degC"][-1]
        assert thermometer.read_quantity("temperature") == pytest.approx(expected_degC, abs=1e-3)
        thermometer.close()


def test_a_thermometer_takes_the_range_that_holds_its_hottest() -> None:
    with standing(ohms=1077.935, truth=OHMS) as fixture:
        thermometer = Keysight34465APt100(fixture.place(r0="1000 ohm", nplc=1))
        assert thermometer.read_quantity("temperature") == pytest.approx(20.0, abs=1e-3)
        assert fixture.at_its_front_panel("FRES:RANG?;NPLC?") == "+1.00000000E+04;+1.00000000E+00"
        thermometer.close()


@pytest.mark.parametrize(
    ("room", "said"),
    [
        (EmptyRoom(), "an overload: beyond 1200 ohm; it is open: check the four wires"),
        (Room(0, 0, 5.0), "5 ohm came back, which with r0 = 100 ohm is outside -200 degC to 850"),
    ],
)
def test_a_broken_wire_is_no_temperature(room: Any, said: str) -> None:
    with standing(truth=OHMS, room=room) as fixture:
        thermometer = Keysight34465APt100(fixture.place())
        with pytest.raises(InstrumentError, match=said):
            burst(fixture, thermometer, 2)
        with pytest.raises(InstrumentError, match=said):
            thermometer.read_quantity("temperature")
        assert fixture.newest("temperature") is None
        thermometer.close()


def test_of_two_meters_that_a_scan_finds_the_second_is_the_thermometer() -> None:
    answers = {
        f"TCPIP::192.0.2.{number}::5025::SOCKET": f"Keysight Technologies,34465A,MY{number},A.03.01"
        for number in (1, 2, 3)
    }
    text = draft([recognised(address, said) for address, said in answers.items()])
    drafted = {name: one["driver"] for name, one in yaml.safe_load(text)["instruments"].items()}
    assert drafted == {"multimeter": "keysight-34465a", "thermometer": "keysight-34465a-pt100"}
    assert "MY3,A.03.01 (keysight-34465a); every place for it is taken" in text
