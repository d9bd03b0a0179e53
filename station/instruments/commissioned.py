"""What a commissioning measured of a bench: the figures that its weekly check is held against."""

from __future__ import annotations

from datetime import date
from typing import Annotated

from pydantic import Field

from station.fields import StrictModel

Words = Annotated[str, Field(min_length=1)]


class CommissionedFigure(StrictModel):
    """A figure as its commissioning measured it, in the unit of the result of that name."""

    name: Words
    axis: Words | None = None
    value: float
    unit: Words
    standard_uncertainty: Annotated[float, Field(ge=0)]


class ConfirmedForm(StrictModel):
    """Which of several forms an instrument has, where its documents do not decide it."""

    instrument: Words
    met: Words


class TriedCommand(StrictModel):
    """What an instrument answered a question that its documents do not confirm, or its error."""

    instrument: Words
    command: Words
    answer: str
    confirmed: bool


class Commissioned(StrictModel):
    """When a bench was commissioned, in which run, and with what figures, forms and answers."""

    date: date
    run: Words
    figures: tuple[CommissionedFigure, ...]
    confirmed: tuple[ConfirmedForm, ...] = ()
    tried: tuple[TriedCommand, ...] = ()

    def figure(self, name: str, axis: str | None) -> CommissionedFigure | None:
        """Return a figure, None where the commissioning did not measure it."""
        for figure in self.figures:
            if (figure.name, figure.axis) == (name, axis):
                return figure
        return None
