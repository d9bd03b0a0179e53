"""Commands of an ACUTROL3000 that other programs send, and the station does not.

From public clients. Assumed: that `:Interlock?` answers with the words that the manual gives for
`:Interlock:Control?` (Close, Open, Fault); that a state vector is position, rate and acceleration,
which `;` parts as it parts the values of an oscillator; that an event register, whose second
argument is not explained, shows the bits that are set now. An oscillator's values are kept and
drive nothing, as `:Mode` does not oscillate here.
"""

from __future__ import annotations

from sim_instruments.acutronic.axes import Axes
from sim_instruments.acutronic.axis import Axis
from sim_instruments.acutronic.language import Language, number

VALUES = 3


def add_others(language: Language, axes: Axes) -> None:
    """Add the commands."""
    add = language.add
    for asked in ("", "?"):
        add(f"Read:Acceleration{asked}", axes.answer(lambda axis, _: axis.acceleration()))
        add(f"Read:SVector{asked}", axes.several(read_vector))
    add("Demand:Acceleration", axes.command(demand_acceleration))
    add("Demand:Acceleration?", axes.answer(lambda axis, _: axis.demands.acceleration))
    add("Demand:Oscillator", axes.command(demand_oscillator))
    add("Demand:Oscillator?", axes.several(lambda axis: list(axis.demands.oscillator)))
    add("Demand:SVector", axes.command(demand_vector))
    add("Demand:SVector?", axes.several(demanded_vector))
    add("Interlock?", axes.answer(lambda axis, _: axis.interlock()))


def read_vector(axis: Axis) -> list[float]:
    """Return position, rate and acceleration."""
    return [axis.position_deg(), axis.rate_deg_per_s(), axis.acceleration()]


def demanded_vector(axis: Axis) -> list[float]:
    """Return the demands of position, rate and acceleration."""
    return [axis.demands.position, axis.demands.rate, axis.demands.acceleration]


def demand_acceleration(axis: Axis, given: list[str]) -> None:
    """Keep a demand of the acceleration mode, which is not simulated."""
    axis.demands.acceleration = number(given, 0)


def demand_oscillator(axis: Axis, given: list[str]) -> None:
    """Keep amplitude (deg), frequency (Hz) and phase (deg)."""
    axis.demands.oscillator = tuple(number(given, place) for place in range(VALUES))


def demand_vector(axis: Axis, given: list[str]) -> None:
    """Take demands of position, rate and acceleration."""
    position, rate, acceleration = (number(given, place) for place in range(VALUES))
    axis.demand("POSITION", position)
    axis.demand("RATE", rate)
    axis.demands.acceleration = acceleration
