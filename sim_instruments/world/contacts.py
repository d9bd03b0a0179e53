"""The switches of the interlock chain, as a person opens and closes them by hand."""

from __future__ import annotations


class HandContacts:
    """Which switches a person holds open now."""

    def __init__(self) -> None:
        self.open: set[str] = set()

    def move(self, name: str, is_open: bool) -> None:
        """Open or close a switch."""
        (self.open.add if is_open else self.open.discard)(name)
