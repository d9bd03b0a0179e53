"""`station --help`: each verb once, in its group."""

from __future__ import annotations

from typing import Any

import typer

from station.cli.app import app
from station.cli.groups import GROUPS


def test_every_verb_stands_in_one_group_with_all_that_it_says() -> None:
    group: Any = typer.main.get_command(app)
    grouped = [verb for verbs in GROUPS.values() for verb in verbs]
    shown = [name for name, command in group.commands.items() if not command.hidden]
    assert sorted(grouped) == sorted(shown)
    help_ = group.get_help(group.context_class(group, info_name="station", terminal_width=80))
    blocks = {block.splitlines()[0]: block for block in help_.split("\n\n")}
    for title, verbs in GROUPS.items():
        lines = blocks[f"{title}:"].splitlines()[1:]
        assert tuple(line.split()[0] for line in lines) == verbs
        for line, verb in zip(lines, verbs, strict=True):
            assert line.endswith(group.commands[verb].help.split("\n")[0]), line
