"""Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def cell(text: str) -> str:
    """Return a text that keeps within its cell."""
    return text.replace("|", "\\|").replace("\n", " ").strip()


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; "none" where there are no rows."""
    lines = [f"| {' | '.join(cell(text) for text in row)} |" for row in rows]
    if not lines:
        return "None.\n"
    rule = "|" + "|".join("---" for _ in head) + "|"
    return "\n".join([f"| {' | '.join(head)} |", rule, *lines]) + "\n"


def code(text: object) -> str:
    """Return a text in code type."""
    return f"`{text}`"


def first_sentence(text: str | None) -> str:
    """Return the first line of a docstring."""
    return (text or "").strip().partition("\n")[0]
