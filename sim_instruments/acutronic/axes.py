"""Axes by number, as the commands of an ACUTROL3000 name them."""

from __future__ import annotations

from collections.abc import Callable

from sim_instruments.acutronic.axis import Axis
from sim_instruments.acutronic.language import OUT_OF_RANGE, AclError, Answer, number


class Axes(dict[int, Axis]):
    """Axes by number; in a command ALL means each of them."""

    def named_axis(self, given: list[str]) -> Axis:
        """Return the axis that the first argument names."""
        n = number(given, 0)
        if n not in self:
            raise AclError(OUT_OF_RANGE)
        return self[int(n)]

    def named(self, given: list[str]) -> list[Axis]:
        """Return the axes that the first argument names."""
        if given and given[0].upper() == "ALL":
            return list(self.values())
        return [self.named_axis(given)]

    def answer(self, answer: Callable[[Axis, list[str]], Answer]) -> Callable[[list[str]], Answer]:
        """Return a query whose first argument is an axis."""
        return lambda given: answer(self.named_axis(given), given[1:])

    def several(self, values: Callable[[Axis], list[float]]) -> Callable[[list[str]], Answer]:
        """Return a query of an axis with several answers, each as of a query of its own."""
        return lambda given: tuple(values(self.named_axis(given)))

    def command(self, act: Callable[[Axis, list[str]], None]) -> Callable[[list[str]], None]:
        """Return a command whose first argument is an axis, or ALL."""

        def command(given: list[str]) -> None:
            for axis in self.named(given):
                act(axis, given[1:])

        return command
