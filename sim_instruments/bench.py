"""A whole simulated bench: the world and the instruments of one bench file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from typing import Any, ClassVar

from sim_instruments.instrument import Setting, SimulatedInstrument
from sim_instruments.seeds import generator
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.laser_gyro_bench import LaserGyroBench
from station.clock import Clock

Maker = Callable[[Setting], SimulatedInstrument]

LARGEST_PORT = 65535
WORLDS: dict[str, Callable[[Truth], LaserGyroBench]] = {"rlg-magnetic-sensitivity": LaserGyroBench}


def installed_simulators() -> dict[str, Maker]:
    """Return the simulators of all installed packages by driver name, the bench itself left out."""
    found = entry_points(group="station.simulators")
    return {entry.name: entry.load() for entry in found if entry.name != "bench"}


class SimulatedBench:
    """Serve the simulated instruments of a bench file, in the world of one procedure.

    `bench` is the raw data of the bench file; its `simulation` mapping holds the seed and the
    truth of the world, the `simulator` mapping of each instrument the instrument's own truth and,
    where wished, a fixed `port`. Instruments whose driver has no simulator are left out.
    `simulators` replaces the installed ones. Raises SimulationError, and OSError whose text names
    instrument and port when a port cannot be had.
    """

    wrong_description: ClassVar[type[Exception]] = SimulationError
    """What is raised when the bench file describes the world or an instrument wrongly."""

    def __init__(
        self,
        bench: Mapping[str, Any],
        clock: Clock,
        procedure: str,
        simulators: Mapping[str, Maker] | None = None,
    ) -> None:
        makers = installed_simulators() if simulators is None else simulators
        whole = Truth(bench, "bench")
        simulation = whole.section("simulation")
        seed = simulation.integer("seed", 0)
        if procedure not in WORLDS:
            raise SimulationError(
                f"no simulated world for the procedure '{procedure}' "
                f"(there is: {', '.join(WORLDS)})"
            )
        self._clock = clock
        self._world = WORLDS[procedure](simulation)
        self._served: dict[str, SimulatedInstrument] = {}
        try:
            for name, entry in whole.raw("instruments").items():
                instrument = Truth(entry, f"instruments.{name}")
                maker = makers.get(instrument.text("driver"))
                if maker is not None:
                    self._served[name] = maker(self._setting(name, instrument, seed))
        except BaseException:
            self.close()
            raise
        self.instruments = {name: one.describe() for name, one in self._served.items()}

    def act(self, prompt_id: str) -> str:
        """Do what a prompt asks a person to do; returns a sentence that says what was done."""
        return self._world.act(prompt_id, self._clock.now())

    def make_ready(self) -> None:
        """Do what a person would have done before others come: mount the device, switch it on."""
        for prompt_id in self._world.preparations:
            self.act(prompt_id)

    def close(self) -> None:
        """Stop serving; the world ends with its instruments."""
        for instrument in self._served.values():
            instrument.close()

    def _setting(self, name: str, instrument: Truth, seed: int) -> Setting:
        truth = instrument.section("simulator")
        # A serial number of the simulator's own stands for the wrong unit on the bench.
        serial = truth.text("serial") if "serial" in truth else instrument.text("serial")
        port = truth.integer("port", 1) if "port" in truth else 0
        if port > LARGEST_PORT:
            raise SimulationError(
                f"{truth.where}.port: a port number goes up to {LARGEST_PORT}, got {port}"
            )
        for other, served in self._served.items():
            if port and served.describe()["port"] == port:
                raise SimulationError(f"{truth.where}.port: {other} has port {port} already")
        return Setting(name, serial, truth, self._world, self._clock, generator(seed, name), port)
