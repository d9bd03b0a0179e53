"""The engine of the test station; it knows no gyro, no coil and no instrument model."""

__version__ = "0.1.0"
