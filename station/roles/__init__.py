"""What a procedure may ask of an instrument: Protocols of a few verbs, whatever the model."""

from station.roles.base import (
    Block,
    Driver,
    DriverSettings,
    Identity,
    Instrument,
    MadeSafe,
    Place,
    SafetyReading,
    SampledSource,
    Tracer,
)
from station.roles.climate import ThermalChamber
from station.roles.field import CoilSettings, CoilSupply, DirectCurrentSupply, Gaussmeter
from station.roles.inertial import Imu, SensorStatus
from station.roles.motion import RotaryStage, TableSettings, Turntable
from station.roles.navigation import Navigator, NavigatorStatus
from station.roles.readings import GyroAcquisition, Multimeter, Thermometer
from station.roles.safe_states import SAFE_STATES, SafeState
from station.roles.spins import (
    CellCoilSettings,
    Digitizer,
    LightSettings,
    PumpLaser,
    SignalGenerator,
)
from station.roles.station import DutPower, InterlockChain

SETTINGS = {
    "coil_supply": CoilSettings,
    "turntable": TableSettings,
    "signal_generator": CellCoilSettings,
    "pump_laser": LightSettings,
}
"""By role: the settings that procedures read, whatever the model; its driver adds its own."""

__all__ = [
    "SAFE_STATES",
    "SETTINGS",
    "Block",
    "CellCoilSettings",
    "CoilSettings",
    "CoilSupply",
    "Digitizer",
    "DirectCurrentSupply",
    "Driver",
    "DriverSettings",
    "DutPower",
    "Gaussmeter",
    "GyroAcquisition",
    "Identity",
    "Imu",
    "Instrument",
    "InterlockChain",
    "LightSettings",
    "MadeSafe",
    "Multimeter",
    "Navigator",
    "NavigatorStatus",
    "Place",
    "PumpLaser",
    "RotaryStage",
    "SafeState",
    "SafetyReading",
    "SampledSource",
    "SensorStatus",
    "SignalGenerator",
    "TableSettings",
    "ThermalChamber",
    "Thermometer",
    "Tracer",
    "Turntable",
]
