"""A sheet as one HTML page that needs nothing beside it."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from markupsafe import Markup

from station.errors import InputError
from station.report.html import environment, style
from station.report.sheet import Sheet

LETTERHEAD = "letterhead.html"


def render_sheet(sheet: Sheet, letterhead: Path | None = None) -> str:
    """Return a sheet as HTML; `letterhead` is a folder with a laboratory's own letterhead.html.

    Raises InputError where it holds none.
    """
    own = resources.files("station.report").joinpath("sheet.css").read_text(encoding="utf-8")
    return (
        environment(sheet.texts)
        .get_template("sheet.html.j2")
        .render(sheet=sheet, css=style() + Markup(own), letterhead=_read(letterhead))
    )


def _read(letterhead: Path | None) -> Markup | None:
    if letterhead is None:
        return None
    file = letterhead / LETTERHEAD
    if not file.is_file():
        raise InputError(f"{letterhead} holds no letterhead: there is no {LETTERHEAD} in it")
    return Markup(file.read_text(encoding="utf-8"))
