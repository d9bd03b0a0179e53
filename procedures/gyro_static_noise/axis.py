"""What is known of one axis at rest when it has been analysed."""

from __future__ import annotations

from dataclasses import dataclass

from procedures.estimation.allan import AllanDeviation
from procedures.estimation.channel import Screened

from .dataset import Array
from .means import Minimum
from .noise_fit import NoiseFit


@dataclass(frozen=True)
class AxisAnalysis:
    """One axis: its screened records, means by switch-on, noise, and Allan deviation."""

    axis: str
    screened: tuple[Screened, ...]
    means: Array
    fit: NoiseFit | None
    minimum: Minimum | None
    curve: AllanDeviation | None

    @property
    def used(self) -> tuple[Screened, ...]:
        """The records of which anything is left."""
        return with_samples(self.screened)


def with_samples(screened: tuple[Screened, ...]) -> tuple[Screened, ...]:
    """Return the records of which anything is left."""
    return tuple(record for record in screened if len(record.there))
