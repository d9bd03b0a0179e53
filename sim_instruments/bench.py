"""A whole simulated bench: the world and the instruments of one bench file."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, ClassVar

import yaml

from sim_instruments.faults.catalogue import possible_faults, read_fault
from sim_instruments.faults.instrument import InstrumentFaults, Schedule
from sim_instruments.instrument import Setting, SimulatedInstrument
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.wire.requests import LineServer
from sim_instruments.wire.tcp import HOST
from sim_instruments.world.base import World
from sim_instruments.world.coils import coil_report
from sim_instruments.world.noise import generator
from station.clock import Clock

Maker = Callable[[Setting], SimulatedInstrument]

OURS = f"{__name__.partition('.')[0]}."
LARGEST_PORT = 65535
MAX_QUOTED = 200
EXAMPLE = "{instrument: coil_supply.x, fault: overdrive}"


@cache
def entries_of(group: str, places: tuple[str, ...]) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group by name, looked up once for the same places of packages.

    Every bench asks, and each look reads what all packages offer. A name of our own stays ours.
    """
    entries = sorted(entry_points(group=group), key=lambda entry: entry.module.startswith(OURS))
    return {entry.name: entry for entry in entries}


def installed_simulators() -> dict[str, Maker]:
    """Return the simulators of all installed packages by driver name, the bench itself left out."""
    entries = entries_of("station.simulators", tuple(sys.path))
    return {name: entry.load() for name, entry in entries.items() if name != "bench"}


def installed_worlds() -> Mapping[str, EntryPoint]:
    """Return the worlds of all installed packages by the procedure that runs in each."""
    return entries_of("station.worlds", tuple(sys.path))


def world_of(procedure: str) -> type[World]:
    """Return the kind of world in which a procedure runs; SimulationError without one."""
    worlds = installed_worlds()
    if procedure not in worlds:
        raise SimulationError(
            f"no simulated world for the procedure '{procedure}' (there is: {', '.join(worlds)})"
        )
    world: type[World] = worlds[procedure].load()
    return world


class SimulatedBench:
    """Serve the simulated instruments of a bench file, in the world of one procedure.

    `bench` is the raw data of the bench file; its `simulation` mapping holds the seed and the
    truth of the world, the `simulator` mapping of each instrument the instrument's own truth and,
    where wished, a fixed `port`. Instruments whose driver has no simulator are left out.
    `simulation.faults` is a list of faults (see `inject`), `simulation.report` a file that gets the
    end state of the world when the bench is closed.
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
        self._seed = simulation.integer("seed", 0)
        self._clock = clock
        self._world = world_of(procedure)(simulation)
        self._schedule = Schedule(clock, self._world.lock)
        self._faults: dict[str, InstrumentFaults] = {}
        self._injected = 0
        self._report_to = simulation.text("report") if "report" in simulation else None
        self._served: dict[str, SimulatedInstrument] = {}
        self._acts: LineServer | None = None
        try:
            for name, entry in whole.raw("instruments").items():
                instrument = Truth(entry, f"instruments.{name}")
                maker = makers.get(instrument.text("driver"))
                if maker is not None:
                    self._faults[name] = InstrumentFaults(self._schedule)
                    self._served[name] = maker(self._setting(name, instrument))
            self.instruments = {name: served.describe() for name, served in self._served.items()}
            for name, entry in whole.raw("instruments").items():
                for shared in entry.get("shares", ())[:1]:  # it answers on that one's line
                    if shared in self.instruments:
                        self.instruments[name] = self.instruments[shared]
            faults = simulation.raw("faults") if "faults" in simulation else []
            if not isinstance(faults, list):
                raise SimulationError(f"simulation.faults: a list was expected, got {faults!r}")
            for number, entry in enumerate(faults, 1):
                self._add_fault(entry, f"simulation.faults[{number}]")
        except BaseException:
            self._report_to = None
            self.close()
            raise

    def act(self, prompt_id: str) -> str:
        """Do what a prompt asks a person to do; returns a sentence that says what was done."""
        return self._world.act(prompt_id, self._clock.now())

    def serve_acts(self) -> dict[str, Any]:
        """Let another process do physical acts: a line holds a prompt's id, the answer is JSON.

        Returns host and port. The answer holds `done`, the sentence, or `unknown`.
        """

        def execute(line: bytes) -> bytes:
            try:
                answer = {"done": self.act(line.decode("utf-8", "replace").strip())}
            except SimulationError as error:
                answer = {"unknown": str(error)}
            return json.dumps(answer).encode() + b"\n"

        self._acts = LineServer("acts", 0, self._clock, nullcontext(), execute)
        self._acts.begin()
        return {"host": HOST, "port": self._acts.port}

    def make_ready(self) -> None:
        """Do what a person would have done before others come: mount the device, switch it on."""
        for prompt_id in self._world.preparations:
            self.act(prompt_id)

    def inject(self, entry: Mapping[str, Any]) -> str:
        """Bring a fault into the bench while it serves, and return a sentence that says so.

        `entry` is what stands in the list `simulation.faults`: `instrument`, `fault`, the options
        of the fault, and when: from `at` on (bench time; at once unless given), at the `nth`
        message that holds the text `command` (on CAN: the frame of that identifier), `count`
        times or `for` a time; once when neither is given. A fault that lasts ends after `for`, or
        never. Raises SimulationError with one sentence.
        """
        self._injected += 1
        return self._add_fault(entry, "fault")

    def answer(self, line: str) -> str:
        """Do what one line of text asks for: a fault to inject, as YAML or JSON, or `report`.

        Returns one line; what is wrong with a fault is stated in it, too.
        """
        if line.strip() == "report":
            return json.dumps(self.simulation_report())
        try:
            entry = yaml.safe_load(line)
            if not isinstance(entry, dict):
                return f"not injected: write `report`, or a fault such as {EXAMPLE}"
            return self.inject(entry)
        except yaml.YAMLError:
            quoted = line.strip()[:MAX_QUOTED]
            return f"not injected: {quoted!r} is neither YAML nor JSON; write {EXAMPLE}"
        except SimulationError as error:
            return f"not injected: {error}"

    def simulation_report(self) -> dict[str, Any]:
        """Return the state of the simulated world now, as plain data for an oracle.

        `time_s`; `coils` by axis (see `coil_report`); `outputs`: which instrument that can harm is
        energised; `dut_powered`, under its older name `gyro_powered` too; `faults`: each with how
        often and when it struck.
        """
        with self._world.lock:
            self._schedule.catch_up()
            now_s = self._clock.now()
            return {
                "time_s": now_s,
                "coils": {
                    axis: coil_report(coil, now_s) for axis, coil in self._world.currents.items()
                },
                "outputs": {
                    name: served.energised()
                    for name, served in self._served.items()
                    if hasattr(served, "energised")
                },
                "dut_powered": self._world.dut_powered,
                "gyro_powered": self._world.dut_powered,
                "faults": [
                    {
                        "instrument": name,
                        "fault": fault.kind,
                        "struck": fault.trigger.met,
                        "first_s": fault.trigger.first_s,
                        "last_s": fault.trigger.last_s,
                    }
                    for name, faults in self._faults.items()
                    for fault in faults.all
                ],
            }

    def close(self) -> None:
        """Stop serving; the world ends with its instruments."""
        if self._report_to is not None:
            text = json.dumps(self.simulation_report(), indent=1)
            Path(self._report_to).write_text(text, encoding="utf-8")
            self._report_to = None
        if self._acts is not None:
            self._acts.close()
        for instrument in self._served.values():
            instrument.close()

    def _add_fault(self, entry: Any, where: str) -> str:
        truth = Truth(entry, where)
        name = truth.text("instrument")
        if name not in self._served:
            raise SimulationError(
                f"{where}.instrument: no simulated instrument '{name}' "
                f"(there are: {', '.join(self._served)})"
            )
        protocol = str(self.instruments[name]["protocol"])
        possible = possible_faults(protocol, type(self._served[name]))
        with self._world.lock:
            now_s = self._clock.now()
            # Each fault draws from its own generator, whatever else happens on the bench.
            rng = generator(self._seed, f"{where} {self._injected} of {name}")
            fault, at_message = read_fault(entry, truth, protocol, possible, now_s, rng)
            self._faults[name].add(fault, at_message=at_message)
        return f"{name}: {fault.kind} injected at {now_s:.3f} s of bench time"

    def _setting(self, name: str, instrument: Truth) -> Setting:
        truth = instrument.section("simulator")
        # A serial number of the simulator's own stands for the wrong unit on the bench.
        serial = truth.text("serial") if "serial" in truth else instrument.text("serial")
        port = truth.integer("port", 1, 0)
        if port > LARGEST_PORT:
            raise SimulationError(
                f"{truth.where}.port: a port number goes up to {LARGEST_PORT}, got {port}"
            )
        for other, served in self._served.items():
            if port and served.describe()["port"] == port:
                raise SimulationError(f"{truth.where}.port: {other} has port {port} already")
        rng = generator(self._seed, name)
        return Setting(name, serial, truth, self._world, self._clock, rng, port, self._faults[name])
