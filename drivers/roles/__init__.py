"""What a procedure may ask of an instrument: Protocols of a few verbs, whatever the model."""

from drivers.roles.base import (
    Block,
    Identity,
    Instrument,
    MadeSafe,
    Place,
    SafetyReading,
    SampledSource,
    Tracer,
)
from drivers.roles.climate import ThermalChamber
from drivers.roles.field import CoilSupply, DirectCurrentSupply, Gaussmeter
from drivers.roles.inertial import Imu, SensorStatus
from drivers.roles.motion import RotaryStage, Turntable
from drivers.roles.navigation import Navigator, NavigatorStatus
from drivers.roles.readings import GyroAcquisition, Multimeter, Thermometer
from drivers.roles.safe_states import SAFE_STATES, SafeState
from drivers.roles.spins import Digitizer, PumpLaser, SignalGenerator
from drivers.roles.station import DutPower, InterlockChain

__all__ = [
    "SAFE_STATES",
    "Block",
    "CoilSupply",
    "Digitizer",
    "DirectCurrentSupply",
    "DutPower",
    "Gaussmeter",
    "GyroAcquisition",
    "Identity",
    "Imu",
    "Instrument",
    "InterlockChain",
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
    "ThermalChamber",
    "Thermometer",
    "Tracer",
    "Turntable",
]
