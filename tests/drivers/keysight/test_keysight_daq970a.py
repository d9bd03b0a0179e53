"""Our driver of the DAQ970A as a thermometer with places, over the real transport."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from daq970a_fixture import CHAMBER_DEGC, DEVICE_DEGC, FAR_K, PLACES, TRUTH, scanner
from keysight_fixture import burst

from drivers.keysight.scanner_daq970a import KeysightDaq970A
from station.errors import InstrumentError
from station.roles.multimeter import is_at_device, place_columns, places_in

FAR = "device_far_temperature_degC"


def test_a_reading_is_one_scan_of_all_places() -> None:
    with scanner() as (here, opened):
        assert list(opened.columns) == [name for place in PLACES for name in place_columns(place)]
        block = burst(here, opened, 4)
        assert len(block) == 4 and list(block.columns) == list(opened.columns)
        read = {place: block.columns[column] for place, column in places_in(block.columns).items()}
        assert np.allclose(read["device"], DEVICE_DEGC, atol=1e-4)
        assert np.allclose(read["device_far"], DEVICE_DEGC + FAR_K, atol=1e-4)
        assert np.allclose(read["chamber"], CHAMBER_DEGC + 0.5, atol=1e-4)
        assert here.newest("temperature") == pytest.approx(DEVICE_DEGC, abs=1e-4)
        assert [place for place in read if is_at_device(place)] == ["device", "device_far"]


def test_places_are_told_by_their_channels_and_not_by_their_order() -> None:
    places = {"chamber": 103, "device_far": 102, "device": 101}
    with scanner(places=places) as (here, opened):
        assert next(iter(opened.columns)) == "resistance_ohm"
        block = burst(here, opened, 2)
        assert np.allclose(block.columns[FAR] - block.columns["temperature_degC"], FAR_K, atol=1e-4)


def test_a_scan_takes_its_places_one_after_another() -> None:
    with scanner(K_per_s=0.1) as (here, opened):
        columns = burst(here, opened, 3).columns
        later_K = columns[FAR] - columns["temperature_degC"] - FAR_K
        # 0.4 s for ten cycles twice, 12.5 ms for the relay.
        assert np.allclose(later_K, 0.1 * 0.4125, rtol=0.01)
        assert np.allclose(np.diff(columns["temperature_degC"]), 3 * 0.1 * 0.4125, rtol=0.01)


def test_a_sensor_has_its_own_resistance() -> None:
    truth = {"channels": {**TRUTH["channels"], "101": {"at": "device", "r0": "100.4 ohm"}}}
    with scanner(truth=truth) as (here, opened):
        assert burst(here, opened, 1).columns["temperature_degC"][0] > DEVICE_DEGC + 1.0
    places = {**PLACES, "device": {"channel": 101, "r0": "100.4 ohm"}}
    with scanner(truth=truth, places=places) as (here, opened):
        read = burst(here, opened, 1).columns["temperature_degC"][0]
        assert read == pytest.approx(DEVICE_DEGC, abs=1e-4)


def test_a_place_whose_sensor_is_open_or_short_reads_no_number_and_the_others_go_on() -> None:
    short = {"channels": {**TRUTH["channels"], "102": {"at": "device", "r0": "3 ohm"}}}
    with scanner(truth=short, places={**PLACES, "shelf": 107}) as (here, opened):
        columns = burst(here, opened, 2).columns
        assert np.isnan(columns["shelf_temperature_degC"]).all()
        assert np.isnan(columns[FAR]).all()
        assert (columns["shelf_resistance_ohm"] > 1e37).all(), "what was read is kept"
        assert np.allclose(columns["temperature_degC"], DEVICE_DEGC, atol=1e-4)
        assert np.allclose(columns["chamber_temperature_degC"], CHAMBER_DEGC + 0.5, atol=1e-4)


def test_a_device_whose_sensor_is_open_or_short_is_an_error() -> None:
    told = pytest.raises(InstrumentError, match=r"the place device, channel 101: .*it is open")
    with scanner({"fault": "overload", "at": "0 s"}) as (here, opened), told:
        burst(here, opened, 1)
    short = {"channels": {**TRUTH["channels"], "101": {"at": "device", "r0": "3 ohm"}}}
    told = pytest.raises(InstrumentError, match=r"the place device.*is outside -200 degC")
    with scanner(truth=short) as (here, opened), told:
        burst(here, opened, 1)


@pytest.mark.parametrize(
    ("channel", "reason"),
    [(201, "there is a DAQM908A in slot 2"), (301, "there is no module in slot 3")],
)
def test_a_channel_that_is_not_there_is_told_by_its_place(channel: int, reason: str) -> None:
    told = pytest.raises(InstrumentError, match=rf"of the place device.*{reason}")
    with scanner(places={"device": channel}) as (_, opened), told:
        opened.start(1)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"places": {"near": 101}}, "there is no place 'device'"),
        ({"places": {"device": 101, "chamber": 101}}, "two places are at the channel 101"),
        ({"places": {"device": 101, "device2": 102}}, "'device2' would not count as a place at"),
        ({"places": {"device": 101, "device-far": 102}}, "'device-far' is no name of a place"),
        ({"places": {"device": 111}}, "111 is no channel for four wires"),
        ({"places": {"device": 401}}, "401 is no channel for four wires"),
        ({"nplc": 3}, "it cannot integrate over nplc 3"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings: dict[str, Any], reason: str) -> None:
    with scanner() as (here, _), pytest.raises(InstrumentError, match=reason):
        KeysightDaq970A(here.place(**{"places": PLACES, **settings}))


def test_an_interlock_reads_the_device_while_a_step_scans() -> None:
    with scanner(nplc=1.0) as (here, opened):
        opened.start(50)
        assert opened.read_quantity("temperature") is None
        here.clock.sleep(1.0)
        assert opened.read_quantity("temperature") == pytest.approx(DEVICE_DEGC, abs=1e-4)
        here.clock.sleep(30.0)
        assert len(opened.fetch()) == 50


def test_what_it_met_is_put_back_and_others_channels_are_left_alone() -> None:
    with scanner() as (here, opened):
        panel = here.at_its_front_panel
        panel("CONF:VOLT 10,(@105)")
        panel("CONF:TEMP FRTD,91,(@102)")
        panel("CONF:RES 1e5,(@101)")
        panel("ROUT:SCAN (@105,101);:TRIG:SOUR TIM;:TRIG:COUN INF;:FORM:READ:TIME ON")
        panel("FORM:READ:CHAN ON")
        asked = "CONF? (@101:105);:ROUT:SCAN?;:TRIG:SOUR?;:TRIG:COUN?;:FORM:READ:TIME?;CHAN?"
        met = panel(asked)
        assert len(burst(here, opened, 2)) == 2
        assert panel("CONF? (@105)") == '"VOLT +1.000000E+01,+3.000000E-06"'
        assert panel(asked) != met
        opened.kept.put_back()
        assert panel(asked) == met
        assert panel("SYST:ERR?") == '+0,"No error"'


def test_a_scanner_that_nobody_set_up_is_left_without_a_scan_list() -> None:
    with scanner() as (here, opened):
        assert len(burst(here, opened, 1)) == 1
        opened.kept.put_back()
        assert here.at_its_front_panel("ROUT:SCAN?;:FORM:READ:CHAN?;:CONF? (@101)") == (
            '#13(@);0;"VOLT +3.000000E+02,+9.000000E-05"'
        )


def test_a_scan_of_somebody_else_is_ended() -> None:
    with scanner() as (here, opened):
        here.at_its_front_panel("CONF:FRES (@101:105);:TRIG:COUN INF;:INIT")
        assert len(burst(here, opened, 2)) == 2


def test_more_than_a_burst_can_hold_is_refused() -> None:
    told = pytest.raises(InstrumentError, match="it can be asked for 3333")
    with scanner() as (_, opened), told:
        opened.start(3334)
