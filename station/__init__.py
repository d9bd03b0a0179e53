"""The engine of the test station; it knows no gyro, no coil and no instrument model."""

from station.packages import take_precedence

__version__ = "0.1.0"

take_precedence()
