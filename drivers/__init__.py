"""Roles a procedure asks for, transports, and one file per instrument model."""

DISTRIBUTION = "inertial-station"
