"""The clock a bench runs on, and the simulated instruments of a bench that is simulated here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from station import registry
from station.clock import Clock, RealClock, VirtualClock, utc_now
from station.errors import InputError, StationError

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def clock_for(bench: Bench, served: Mapping[str, Any] | None = None, began_s: float = 0.0) -> Clock:
    """Return a clock: real for a real bench, virtual for one simulated here.

    `served`, the first line of a `station sim`, gives that bench's own clock. The others begin at
    run time `began_s`: where a run goes on, after its last event.
    """
    if served is not None:
        time = served["clock"]
        return RealClock(float(time["speed"]), float(time["epoch_unix"]))
    if bench.simulation is not None:
        return VirtualClock(began_s)
    return RealClock(1.0, utc_now().timestamp() - began_s) if began_s else RealClock()


def simulators_of(bench: Bench) -> Mapping[str, Any]:
    """Return all simulators that can be loaded by driver, the bench itself left out.

    Raises InputError where one that the bench needs cannot be loaded.
    """
    found = dict(registry.loaded(registry.SIMULATORS))
    for driver in (entry.driver for entry in bench.instruments.values()):
        if driver in registry.names(registry.SIMULATORS) and driver not in found:
            registry.load(registry.SIMULATORS, driver)
    return {name: one for name, one in found.items() if name != registry.SIMULATED_BENCH}


def serve_bench(bench: Bench, clock: Clock, procedure: str) -> Any:
    """Begin to serve the simulated instruments of a bench, in the world of a procedure.

    Raises InputError when the bench file describes them wrongly, StationError when a port that
    it names cannot be had.
    """
    simulator = registry.load(registry.SIMULATORS, registry.SIMULATED_BENCH)
    try:
        return simulator(bench.data, clock, procedure, simulators_of(bench))
    except simulator.wrong_description as error:
        raise InputError(f"{bench.path}: {error}") from error
    except OSError as error:
        raise StationError(
            f"{error.strerror or error}; end the program that has the port, or take "
            f"`simulator.port` out of {bench.path} for a free one"
        ) from error
