"""Contacts that are wired wrongly, as a simulated bench is given them."""

from __future__ import annotations

import random

from plants import Bench, Plant, Planted

CONTACTS = ("e-stop", "door")


def inverted_door(bench: Bench, rng: random.Random) -> Planted:
    bench["instruments"]["thermal_chamber"]["simulator"]["door_inverted"] = True
    return "door-contact-inverted", None


def stuck_door(bench: Bench, rng: random.Random) -> Planted:
    # The input that the bench file states is another one.
    bench["instruments"]["thermal_chamber"]["simulator"]["inputs"] = {"2.2": "spare"}
    return "door-contact-stuck", None


def bridged_contact(bench: Bench, rng: random.Random) -> Planted:
    bench["instruments"]["interlock_chain"]["simulator"]["bridged"] = rng.choice(CONTACTS)
    return "chain-contact-bridged", None


PLANTS = (
    Plant("inverted door contact", "contacts", inverted_door),
    Plant("door contact on another input", "contacts", stuck_door),
    Plant("bridged contact of the interlock chain", "contacts", bridged_contact),
)
