"""What a procedure may ask of an instrument: Protocols of a few verbs, whatever the model.

Each file declares all of one role; `ROLES` has the station's own.
"""

from station.roles.base import (
    EXCHANGE_DEADLINE_S,
    MAX_DEADLINE_S,
    TRIES,
    UNTOLD,
    Block,
    Driver,
    DriverSettings,
    Identity,
    Instrument,
    KeepsErrors,
    MadeSafe,
    Place,
    SafetyReading,
    SampledSource,
    Shares,
    Tracer,
    published,
    quantity,
)
from station.roles.cell_heater import CELL_HEATER, CellHeater
from station.roles.coil_supply import (
    COIL_SUPPLY,
    CoilSettings,
    CoilSupply,
    DirectCurrentSupply,
    ProvesItself,
)
from station.roles.digitizer import DIGITIZER, Digitizer
from station.roles.dut_power import DUT_POWER, DutPower
from station.roles.gaussmeter import GAUSSMETER, Gaussmeter
from station.roles.gyro_acquisition import GYRO_ACQUISITION, GyroAcquisition
from station.roles.imu import IMU, Imu, SensorStatus
from station.roles.interlock_chain import INTERLOCK_CHAIN, InterlockChain
from station.roles.multimeter import MULTIMETER, THERMOMETER, Multimeter, Thermometer
from station.roles.navigator import NAVIGATOR, Navigator, NavigatorStatus
from station.roles.pump_laser import PUMP_LASER, LightSettings, PumpLaser
from station.roles.role import Limit, Quantity, Role, SafeState
from station.roles.rotary_stage import ROTARY_STAGE, RotaryStage
from station.roles.signal_generator import SIGNAL_GENERATOR, CellCoilSettings, SignalGenerator
from station.roles.thermal_chamber import THERMAL_CHAMBER, ThermalChamber
from station.roles.turntable import TURNTABLE, TableSettings, Turntable, need_axis

ROLES = (
    COIL_SUPPLY,
    GAUSSMETER,
    MULTIMETER,
    THERMOMETER,
    ROTARY_STAGE,
    TURNTABLE,
    THERMAL_CHAMBER,
    GYRO_ACQUISITION,
    NAVIGATOR,
    IMU,
    SIGNAL_GENERATOR,
    DIGITIZER,
    PUMP_LASER,
    CELL_HEATER,
    DUT_POWER,
    INTERLOCK_CHAIN,
)
"""In the order in which a bench file, its schema and the reference list them."""

__all__ = [
    "EXCHANGE_DEADLINE_S",
    "MAX_DEADLINE_S",
    "ROLES",
    "TRIES",
    "UNTOLD",
    "Block",
    "CellCoilSettings",
    "CellHeater",
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
    "KeepsErrors",
    "LightSettings",
    "Limit",
    "MadeSafe",
    "Multimeter",
    "Navigator",
    "NavigatorStatus",
    "Place",
    "ProvesItself",
    "PumpLaser",
    "Quantity",
    "Role",
    "RotaryStage",
    "SafeState",
    "SafetyReading",
    "SampledSource",
    "SensorStatus",
    "Shares",
    "SignalGenerator",
    "TableSettings",
    "ThermalChamber",
    "Thermometer",
    "Tracer",
    "Turntable",
    "need_axis",
    "published",
    "quantity",
]
