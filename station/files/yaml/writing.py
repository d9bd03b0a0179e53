"""Write data as YAML that our own reading gives back unchanged."""

from __future__ import annotations

from typing import Any

import yaml

from station.files.yaml.reading import plain_scalar

_NEVER_WRAPPED = 1_000_000


class _Dumper(yaml.SafeDumper):
    """Quotes every text that YAML 1.2 or 1.1 would take for something else."""

    def ignore_aliases(self, data: object) -> bool:
        """Write equal values out each time; anchors are refused on reading."""
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    plain = plain_scalar(text) == text and text.isascii() and text.isprintable()
    style = None if plain else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text)


def yaml_text(data: dict[str, Any]) -> str:
    """Return plain data as YAML text, keys in the order given, each scalar on a line of its own."""
    text: str = yaml.dump(
        data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=_NEVER_WRAPPED
    )
    return text
