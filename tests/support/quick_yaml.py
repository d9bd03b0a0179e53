"""YAML that tests read and write in great numbers, by libyaml where PyYAML has it."""

from __future__ import annotations

from typing import Any

import yaml

_Loader = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
_Dumper = yaml.CSafeDumper if yaml.__with_libyaml__ else yaml.SafeDumper


def load_yaml(text: str) -> Any:
    """Return what `yaml.safe_load` returns."""
    return yaml.load(text, _Loader)


def dump_yaml(data: Any, **options: Any) -> str:
    """Return what `yaml.safe_dump` returns."""
    text: str = yaml.dump(data, Dumper=_Dumper, **options)
    return text
