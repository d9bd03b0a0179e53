"""The verbs in four groups, as `station --help` lists them."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from station.errors import InputError
from station.speech import HERE

GROUPS = {
    "Run": ("run", "attach", "pause", "resume", "abort", "acknowledge", "panel"),
    "Look": ("list", "status", "report", "export", "history", "compare"),
    "Set up": ("new", "validate", "scan", "identify", "commission", "sim", "schema"),
    "Laboratory": ("analyse", "replay", "verify", "sign"),
}


LANG = "--lang"


def speak(language: str | None) -> None:
    """Take the language of this terminal, before anything is said; raises InputError."""
    if language is None:
        return
    from station.texts import languages

    if language not in languages():
        raise InputError(f"no terminal is in {language!r}; choose --lang {', '.join(languages())}")
    HERE.language = language


def speaks(
    lang: Annotated[
        str | None,
        typer.Option(
            LANG,
            metavar="[en|zh]",
            help="Language of this terminal, in place of the computer's (LC_ALL, LANG).",
            expose_value=False,
            is_eager=True,
            callback=speak,
        ),
    ] = None,
) -> None:
    """Hold the option of every verb that has none of its own."""


class Verbs(TyperGroup):
    """The command line, whose help lists each verb in its group; each verb has `--lang`."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        alone = typer.Typer(add_completion=False)
        alone.command()(speaks)
        language = typer.main.get_command(alone).params[:1]
        for command in (self, *self.commands.values()):
            if not any(LANG in parameter.opts for parameter in command.params):
                command.params.extend(language)

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
