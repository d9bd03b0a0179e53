"""Instruments that answer in the place of others: which are exchanged, and which are one unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.instruments.opening import Probe


def explained(bench: Bench, probes: Sequence[Probe]) -> list[Probe]:
    """Return the probes; what answers with another entry's serial number names that entry."""
    serials = {name: entry.serial for name, entry in bench.instruments.items() if entry.serial}
    owners = {serial: name for name, serial in serials.items()}
    answered = {one.name: one.found.identity.serial for one in probes if one.found is not None}
    return [replace(one, said=one.said + hint(one, owners, serials, answered)) for one in probes]


def hint(
    probe: Probe, owners: dict[str, str], serials: dict[str, str], answered: dict[str, str]
) -> str:
    """Return what the serial number that answered says of the cables; empty where nothing."""
    serial = answered.get(probe.name)
    owner = owners.get(serial or "")
    if probe.ok or owner is None or owner == probe.name:
        return ""
    if answered.get(owner) == serial:
        return f"; {owner} answers with it, too: the addresses of both lead to one instrument"
    if answered.get(owner) == serials.get(probe.name):
        return f"; it is that of {owner}, which answers with this one's: the two are exchanged"
    return f"; it is that of {owner}"
