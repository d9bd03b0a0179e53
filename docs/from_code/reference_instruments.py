"""What each driver sends, where that is documented, and whether its simulator knows it."""

from __future__ import annotations

import importlib

from simulated import answered
from tables import code, first_sentence, table

from station import registry
from station.roles.sources import rows_of

HEAD = ("command", "for", "source", "confirmed")


def instruments() -> str:
    """Return a section for each driver of the station's own."""
    parts = []
    for name, driver in own_drivers().items():
        module = importlib.import_module(driver.__module__)
        parts.append(f"## {name}\n\n{first_sentence(module.__doc__)}\n\n")
        rows = [
            (code(one.command), *one[1:], answered(name, one.command)) for one in rows_of(driver)
        ]
        parts.append(table((*HEAD, "simulator"), rows) + "\n")
    return "".join(parts)


def own_drivers() -> dict[str, type]:
    """Return the drivers that come with the station, by name."""
    names = registry.own_names(registry.DRIVERS)
    return {name: registry.load(registry.DRIVERS, name) for name in names}
