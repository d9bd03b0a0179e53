"""A bench that can be opened: a real one, one simulated here, or one that is served elsewhere."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol

from station import registry
from station.clock import Clock, RealClock, VirtualClock, utc_now
from station.errors import InputError, StationError
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


def simulators_of(drivers: Iterable[str]) -> Mapping[str, Any]:
    """Return the simulators of drivers by driver; some have none.

    Raises InputError where one cannot be loaded.
    """
    offered = {*registry.names(registry.SIMULATORS)} - {registry.SIMULATED_BENCH}
    return {
        driver: registry.load(registry.SIMULATORS, driver)
        for driver in sorted({*drivers} & offered)
    }


def serve_bench(bench: Bench, clock: Clock, procedure: str) -> Any:
    """Begin to serve the simulated instruments of a bench, in the world of a procedure.

    Raises InputError when the bench file describes them wrongly, StationError when a port that
    it names cannot be had.
    """
    simulator = registry.load(registry.SIMULATORS, registry.SIMULATED_BENCH)
    simulators = simulators_of(entry.driver for entry in bench.instruments.values())
    try:
        return simulator(bench.data, clock, procedure, simulators)
    except simulator.wrong_description as error:
        raise InputError(f"{bench.path}: {error}") from error
    except OSError as error:
        raise StationError(
            f"{error.strerror or error}; end the program that has the port, or take "
            f"`simulator.port` out of {bench.path} for a free one"
        ) from error


ACT_WITHIN_S = 5.0
RESUME = "resume"
"""The prompt that asks a person whether a bench is as it was."""


def served_acts(place: Mapping[str, Any] | None) -> Callable[[str], str]:
    """Return what does a physical act in a world that another process serves.

    What that world does not know of, or a server without `acts`, was done when it began.
    """

    def act(prompt_id: str) -> str:
        if place is not None:
            host, port = str(place["host"]), int(place["port"])
            try:
                with socket.create_connection((host, port), ACT_WITHIN_S) as line:
                    line.sendall(prompt_id.encode() + b"\n")
                    reply = json.loads(line.makefile("rb").readline())
            except (OSError, ValueError) as error:
                raise StationError(
                    f"{prompt_id}: the served bench does not answer ({error}); is `station sim` "
                    "still running?"
                ) from error
            if "done" in reply:
                return str(reply["done"])
        return f"{prompt_id}: done when the simulated bench was served"

    return act


class Replay(Protocol):
    """A transcript in the place of every instrument: its time, addresses, and what people did."""

    @property
    def clock(self) -> Clock:
        """The time on which the transcript is served."""
        ...

    @property
    def addresses(self) -> Mapping[str, str]:
        """The address of each instrument."""
        ...

    def act(self, prompt_id: str) -> str:
        """Return what was answered to a prompt."""
        ...


class BenchSession:
    """The clock and the addresses of a bench, for as long as it is in use.

    `addresses` are those of simulated instruments; `act` does a physical act in their world, None
    where a person must. `served` is the first line of `station sim`. `began_s` is the run time at
    which a bench on virtual time begins: that of the log's last event where a run goes on. `replay`
    takes the place of every instrument.
    """

    def __init__(
        self,
        bench: Bench,
        procedure: str,
        served: Mapping[str, Any] | None = None,
        began_s: float = 0.0,
        replay: Replay | None = None,
    ) -> None:
        self.real = bench.simulation is None and served is None and replay is None
        self.here = (bench.simulation is not None and served is None) or replay is not None
        """Whether the bench is simulated in this process, and ends with it."""
        self.clock: Clock = replay.clock if replay else clock_for(bench, served, began_s)
        self.replayed = replay is not None
        self._simulation = None
        self.addresses: dict[str, str] = {}
        self.world = "" if served is None else f"served since {served['clock']['epoch_unix']}"
        """What sets the instruments of a served bench apart from others of the same serials."""
        self.act: Callable[[str], str] | None = None
        if replay is not None:
            self.addresses, self.act = dict(replay.addresses), replay.act
        elif served is not None:
            self.addresses = {
                name: str(entry["address"]) for name, entry in served["instruments"].items()
            }
            if served.get("procedure", procedure) != procedure:
                raise InputError(
                    f"the served bench is the world of {served['procedure']}; serve this one with "
                    f"`station sim BENCH --procedure {procedure}`"
                )
            self.act = served_acts(served.get("acts"))
        elif self.here:
            self._simulation = serve_bench(bench, self.clock, procedure)
            instruments = self._simulation.instruments
            self.addresses = {
                name: str(instrument["address"]) for name, instrument in instruments.items()
            }
            self.act = self._simulation.act

    @property
    def act_again(self) -> Callable[[str], str] | None:
        """As `act`, for a run that goes on: a world that began anew is made ready first."""
        if self._simulation is None or self.act is None:
            return self.act
        prepared, act = self._simulation.make_ready, self.act

        def acted(prompt_id: str) -> str:
            if prompt_id != RESUME:
                return act(prompt_id)
            prepared()
            return "The simulated bench began anew and was prepared as before."

        return acted

    def __enter__(self) -> BenchSession:
        return self

    def __exit__(self, *_: object) -> None:
        if self._simulation is not None:
            self._simulation.close()
        self.clock.stop()
