"""A sheet as PDF, set by typst; its fonts come with Matplotlib, others are the computer's own."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from importlib import resources
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from station.errors import InputError
from station.report.sheet import Sheet
from station.texts import ENGLISH

FIRST_IDEOGRAPH = 0x3400
OF_ANOTHER_COUNTRY = re.compile(r"\b(JP|KR|TC|HK)\b|Gothic|Mincho")
"""Fonts whose signs are Japanese, Korean or traditional, though they have the simplified ones."""
MAIN, LETTERHEAD = "sheet.typ", "letterhead.typ"


def render_pdf(sheet: Sheet, *, paper: str = "a4", letterhead: Path | None = None) -> bytes:
    """Return a sheet as PDF; `paper` is a4 or letter, `letterhead` a laboratory's own folder.

    The same sheet gives the same bytes. Raises InputError where the letterhead cannot be used.
    """
    return _compiled(sheet, paper, letterhead, "pdf")[0]


def render_pages(sheet: Sheet, *, paper: str = "a4", ppi: float = 110.0) -> list[bytes]:
    """Return the pages of a sheet as PNG, with `ppi` pixels per inch."""
    return _compiled(sheet, paper, None, "png", ppi)


def _compiled(
    sheet: Sheet,
    paper: str,
    letterhead: Path | None,
    format: Literal["pdf", "png"],
    ppi: float | None = None,
) -> list[bytes]:
    import matplotlib as mpl
    import typst

    fonts = [Path(mpl.get_data_path()) / "fonts" / "ttf"]
    inputs = {"paper": paper}
    data = json.dumps(sheet.to_data(), ensure_ascii=False)
    if sheet.texts.languages != (ENGLISH,):
        file, inputs["font"] = font_with({sign for sign in data if ord(sign) >= FIRST_IDEOGRAPH})
        fonts.append(file.parent)
    files: dict[str, bytes] = {
        LETTERHEAD: _own(LETTERHEAD),
        **_files_of(letterhead),
        MAIN: _own(MAIN),
        "sheet.json": data.encode(),
        **sheet.pictures(),
    }
    with TemporaryDirectory() as folder:
        for name, content in files.items():
            (Path(folder) / name).write_bytes(content)
        try:
            made: bytes | list[bytes] = typst.compile(
                Path(folder) / MAIN,
                font_paths=fonts,
                format=format,
                ppi=ppi,
                sys_inputs=inputs,
            )
        except typst.TypstError as error:
            if letterhead is None:
                raise
            raise InputError(f"the letterhead in {letterhead} cannot be set: {error}") from error
    return made if isinstance(made, list) else [made]


def font_with(signs: set[str]) -> tuple[Path, str]:
    """Return file and family of the first font of the computer that has all of some signs.

    One that writes them as another country does comes last. Raises InputError where none has.
    """
    from matplotlib.font_manager import findSystemFonts
    from matplotlib.ft2font import FT2Font

    wanted = {ord(sign) for sign in signs}
    others: list[tuple[Path, str]] = []
    for name in sorted(findSystemFonts()):
        with suppress(RuntimeError, OSError):  # a file that is no font
            font = FT2Font(name)
            if not wanted <= font.get_charmap().keys():
                continue
            if not OF_ANOTHER_COUNTRY.search(font.family_name):
                return Path(name), font.family_name
            others.append((Path(name), font.family_name))
    if others:
        return others[0]
    raise InputError(
        "no font of this computer has the signs of this language; install one, such as Debian's "
        "fonts-wqy-zenhei, or make the report as html"
    )


def _own(name: str) -> bytes:
    return resources.files("station.report").joinpath(name).read_bytes()


def _files_of(letterhead: Path | None) -> dict[str, bytes]:
    """Return the files of a letterhead's folder by name; raises InputError where it has none."""
    if letterhead is None:
        return {}
    if not (letterhead / LETTERHEAD).is_file():
        raise InputError(f"{letterhead} holds no letterhead: there is no {LETTERHEAD} in it")
    return {file.name: file.read_bytes() for file in letterhead.iterdir() if file.is_file()}
