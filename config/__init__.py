"""Shipped plans, benches, message files and schemas, read as package data."""

DISTRIBUTION = "inertial-station"
