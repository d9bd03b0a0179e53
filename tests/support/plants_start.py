"""Faults by which a commissioning ends at its start, as a simulated bench is given them."""

from __future__ import annotations

import random

from plants import BOTH, Bench, Ends, Plant

SUPPLIES = ("coil_supply.x", "coil_supply.y", "coil_supply.z")
ALTERNATE = ("sim-alternate",)
CONTACTS = ("e-stop", "door")


def exchanged_serials(bench: Bench, rng: random.Random) -> Ends:
    one, other = rng.sample(SUPPLIES, 2)
    entries = [bench["instruments"][name] for name in (one, other)]
    for entry, answers in zip(entries, [e["serial"] for e in reversed(entries)], strict=True):
        entry["simulator"]["serial"] = answers
    return Ends(3, (f"{one}: serial number", f"{other}: serial number", "the two are exchanged"))


def one_address_twice(bench: Bench, rng: random.Random) -> Ends:
    one, other = rng.sample(SUPPLIES, 2)
    instruments = bench["instruments"]
    instruments[other]["simulator"]["serial"] = instruments[one]["serial"]
    return Ends(3, (one, other, "the addresses of both lead to one instrument"))


def open_chain(bench: Bench, rng: random.Random) -> Ends:
    contact = rng.choice(CONTACTS)
    fault = {"instrument": "interlock_chain", "fault": "chain-open", "contact": contact}
    bench["simulation"]["faults"] = [{**fault, "at": "0 s", "for": "1 h"}]
    return Ends(5, (f"open: {contact}",))


def inverted_door_in_chain(bench: Bench, rng: random.Random) -> Ends:
    inputs = bench["instruments"]["thermal_chamber"]["simulator"]
    inputs["door_inverted"] = True
    return Ends(5, ("open: thermal_chamber door",))


PLANTS = (
    Plant("exchanged serial numbers", "coils", exchanged_serials, BOTH),
    Plant("two supplies at one address", "coils", one_address_twice, BOTH),
    Plant("open interlock chain", "contacts", open_chain),
    Plant("inverted door contact in the chain", "contacts", inverted_door_in_chain, ALTERNATE),
)
