"""The command line of a benchmark that measures an estimator case by case."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

from figures import Figures


class Named(Protocol):
    """A case; `--case` chooses it by a part of its name."""

    @property
    def name(self) -> str:
        """What stands in front of its figures."""
        ...


C = TypeVar("C", bound=Named)


def print_cases(
    about: str, cases: Iterable[C], measure: Callable[[C, int], dict[str, object]], runs: int = 2000
) -> None:
    """Print what `measure` finds of each chosen case, one JSON object a line."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--runs", type=int, default=runs)
    parser.add_argument("--case", help="only the cases whose name contains this")
    figures = Figures(parser)
    options = figures.parse()
    for case in cases:
        if options.case is None or options.case in case.name:
            figures.line(case.name, **measure(case, options.runs))
