"""Run folders in a store that a URL names, such as a bucket: listed, and copied to be read.

`fsspec` reaches the store, with the addresses and keys that it finds in its own configuration and
in the environment; nothing is written there.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from station.errors import InputError, StationError, reason_of
from station.record.files import not_written
from station.record.layout import EVENTS, EXPORTS, MANIFEST, RAW, covered_files

URL = re.compile(r"[a-z][a-z0-9+.-]*://", re.IGNORECASE)


def is_url(store: str) -> bool:
    """Whether a text names a store by its URL, and not a folder."""
    return URL.match(store) is not None


def refuse_keys(store: str) -> None:
    """Raise InputError, which does not repeat it, for a URL that holds keys or a second URL."""
    user = store.partition("://")[2].partition("/")[0].rpartition("@")[0]
    if is_url(store) and ("::" in store or ":" in user):
        raise InputError(
            "the URL of a store holds no password and no second URL; keys belong into the "
            "environment, or the configuration of fsspec"
        )


def run_urls(store: str) -> list[str]:
    """Return the URLs of the run folders of a store, at any depth; raises InputError for none."""
    listed = _listed(store)
    runs = {file.removesuffix(EVENTS).rstrip("/") for file in listed if _name(file) == EVENTS}
    # What no terminal can show gets a name that leads nowhere, and so a row that says so.
    shown = (ascii(run) if not run.isprintable() else run for run in runs)
    urls = sorted(
        f"{store.rstrip('/')}/{run}".rstrip("/")
        for run in shown
        if not _name(run).startswith(".") or _name(run) in (".", "..")
    )
    if not urls:
        raise InputError(
            f"there is no run folder below {store}, or this user may not list it; name the bucket "
            "or the folder that holds them"
        )
    return urls


@contextmanager
def run_at_hand(run: str, *, raw: bool = True) -> Iterator[Path]:
    """Yield the folder of a run; of one that a URL names a copy, which is removed afterwards.

    Without `raw` the raw data stay where they are. Raises InputError where the store cannot be
    reached, and where the run is not complete there.
    """
    if not is_url(run):
        yield Path(run)
        return
    with TemporaryDirectory(prefix="station-run-", ignore_cleanup_errors=True) as place:
        try:
            yield _copied(run, Path(place), raw=raw)
        except StationError as error:  # whoever reads it looks for the run, not for its copy
            error.args = (str(error).replace(f"{place}/{_name(run)}", run),)
            raise


def _copied(run: str, place: Path, *, raw: bool) -> Path:
    listed = _listed(run)
    name = _name(run)
    _refuse_outside(run, name)
    folder = place / name
    with _reached(run) as (store, root):
        for file in sorted(listed):
            top = file.partition("/")[0]
            if top == EXPORTS or (top == RAW and not raw):
                continue
            _refuse_outside(run, *file.split("/"))
            target = folder / file
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                store.get_file(f"{root}/{file}", str(target))
            except OSError as error:
                if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS):
                    raise not_written(target, error, "name another one in TMPDIR") from error
                raise
    if MANIFEST not in listed:
        raise InputError(
            f"{run} holds no {MANIFEST}: the copy is not complete, or the run did not end; copy it "
            "again when it has ended"
        )
    missing = [name for name in covered_files(folder) if name not in listed]
    if missing:
        raise InputError(
            f"{run} is not complete: it lacks {len(missing)} files that its {MANIFEST} names, such "
            f"as {missing[0]}; copy it again"
        )
    return folder


def _refuse_outside(run: str, *names: str) -> None:
    """Raise InputError for a name that leads out of a folder: a bucket may hold any."""
    for name in names:
        if name in ("", ".", "..") or not name.isprintable() or {"\\", ":"} & set(name):
            raise InputError(
                f"{run} holds a file with the name {'/'.join(names)!a}, which no run writes; "
                "delete it there"
            )


def _listed(url: str) -> set[str]:
    """Return the paths of all files below a URL, from there."""
    with _reached(url) as (store, root):
        store.invalidate_cache()
        files = store.find(root, detail=True)
        paths = {
            path.removeprefix(root).removeprefix("/")
            for path, facts in files.items()
            if facts.get("type") == "file" and not facts.get("islink")
        }
    # An empty object whose name ends with a slash is what a bucket has of a folder.
    return {path for path in paths if path and not path.endswith("/")}


@contextmanager
def _reached(url: str) -> Iterator[tuple[Any, str]]:
    """Yield a file system and a path in it; every error of whatever library is a sentence."""
    refuse_keys(url)
    try:
        import fsspec

        yield fsspec.core.url_to_fs(url)
    except StationError:
        raise
    except ImportError as error:
        raise InputError(
            f"{url} needs a package that is not installed ({reason_of(error)}); run `pip install "
            "inertial-station[cluster,s3]`, without s3 for a store that is no s3://"
        ) from error
    except Exception as error:  # each kind of store has errors of its own
        raise InputError(
            f"{url} cannot be read ({reason_of(error)}); check the address, the keys and the "
            "network, then do this again"
        ) from error


def _name(path: str) -> str:
    return path.rpartition("/")[2]
