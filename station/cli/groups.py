"""The verbs in four groups, as `station --help` lists them."""

from __future__ import annotations

from typing import Any

from typer.core import TyperGroup

GROUPS = {
    "Run": ("run", "attach", "pause", "resume", "abort", "acknowledge", "panel"),
    "Look": ("list", "status", "report", "export", "history", "compare"),
    "Set up": ("new", "validate", "scan", "identify", "commission", "sim", "schema"),
    "Laboratory": ("analyse", "replay", "verify", "sign"),
}


class Verbs(TyperGroup):
    """The command line, whose help lists each verb in its group."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the verbs of each group, with what each does."""
        widest = max(map(len, self.commands))
        for group, verbs in GROUPS.items():
            rows = [
                (
                    verb.ljust(widest),
                    self.commands[verb].get_short_help_str(formatter.width - widest - 6),
                )
                for verb in verbs
            ]
            with formatter.section(group):
                formatter.write_dl(rows)
