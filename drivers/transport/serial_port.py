"""Where drivers of before take `SerialSettings` from: they are in `ports`."""

from drivers.transport.ports import BaudRate as BaudRate
from drivers.transport.ports import DataBits as DataBits
from drivers.transport.ports import Handshake as Handshake
from drivers.transport.ports import Parity as Parity
from drivers.transport.ports import SerialSettings as SerialSettings
