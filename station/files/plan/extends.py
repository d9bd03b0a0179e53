"""`extends: other-plan`: a plan that says only in what it differs from another.

Mappings merge, everything else replaces: a list is replaced as a whole. A base may extend a base
of its own.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from station.files.faults import FaultList, listed, nearest
from station.files.lookup import PLANS, available, find, is_there
from station.files.yaml.document import Document, Where
from station.files.yaml.reading import read_yaml

EXTENDS = "extends"
_SUFFIX = ".yaml"


def layers_of(plan: Document) -> list[Document]:
    """Return the files of a plan: itself, the plan that it extends, that one's base, and so on.

    Raises FaultList for a base that is not there, cannot be read, or closes a circle.
    """
    layers = [plan]
    while EXTENDS in layers[-1].data:
        path = base_path(layers[-1])
        known = [layer.path.resolve() for layer in layers]
        if path.resolve() in known:
            circle = [*layers[known.index(path.resolve()) :], layers[known.index(path.resolve())]]
            way = " extends ".join(layer.path.name for layer in circle)
            what = f"the plans extend each other in a circle: {way}"
            raise FaultList([layers[-1].fault((EXTENDS,), what)])
        layers.append(_read_base(path))
    return layers


def _read_base(path: Path) -> Document:
    try:
        status = path.stat()
    except OSError:
        return read_yaml(path)  # says why in a sentence
    return _read_once(path, path.resolve(), status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=32)
def _read_once(path: Path, whole_path: Path, changed_ns: int, size: int) -> Document:
    """Read a base once for all the plans that extend it; nothing changes the document."""
    return read_yaml(path)


def base_path(plan: Document) -> Path:
    """Return the file that a plan extends: a path from the plan's folder, or a plan's name.

    Raises FaultList at the line of `extends`.
    """
    name = plan.data[EXTENDS]
    if not isinstance(name, str) or not name.strip():
        what = "must be the name of another plan, or its path seen from this file"
        raise FaultList([plan.fault((EXTENDS,), what)])
    folder = plan.path.parent
    for file in (folder / name, folder / f"{name}{_SUFFIX}"):
        if is_there(file):
            return file
    wanted = name.removesuffix(_SUFFIX)
    named = [known for known, _ in available(PLANS)]
    # A bare name is that of a plan; anything else would be looked for where the command was given.
    if wanted in named:
        return find(PLANS, wanted)
    here = [path.stem for path in sorted(folder.glob(f"*{_SUFFIX}")) if path != plan.path]
    known = list(dict.fromkeys([*here, *named]))
    hint = nearest(Path(wanted).name, known)
    what = f"there is no plan '{name}', neither as a file seen from this one nor by name"
    what += "" if hint else f"; there are {listed(known)}"
    raise FaultList([plan.fault((EXTENDS,), what, hint and f"'{hint}'")])


def merged(layers: list[Document]) -> Document:
    """Return one document of a plan's files, the plan itself first; every place names its file."""
    plan = layers[0].stamped()
    result = layers[-1].stamped()
    result = Document(
        result.data, plan.path, plan.text, result.positions, result.key_positions, result.scalars
    )
    result.remove(EXTENDS)
    for layer in reversed(layers[:-1]):
        over = layer.stamped()
        over.remove(EXTENDS)
        _merge(result, over, ())
    return result


def _merge(result: Document, over: Document, where: Where) -> None:
    """Lay the mapping at a path of `over` on that of `result`."""
    result.positions[where] = over.positions[where]
    below = result.at(where)
    for key, value in over.at(where).items():
        here = (*where, key)
        if isinstance(value, dict) and isinstance(below.get(key), dict):
            _merge(result, over, here)
        else:
            result.graft(here, over, here)
        result.key_positions[here] = over.key_positions[here]
