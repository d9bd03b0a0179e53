"""A small run in a process of its own: it drives coils under a guardian until it is killed.

python guarded_run.py SERVED PARENT FREQUENCY_HZ AMPLITUDE_A COIL…

It says `energised` once the sines run, then measures a current every 0.1 s and never ends. With
`gaussmeter` among the coils that is the witness of the others.
"""

from __future__ import annotations

import json
import sys
from importlib.resources import files
from pathlib import Path
from typing import Any, cast

from station import registry
from station.clock import RealClock
from station.files.plan import read_plan
from station.guardian.supervisor import Guardian
from station.instruments.bench import read_bench
from station.instruments.instrument_locks import InstrumentLocks
from station.instruments.opening import open_instruments
from station.method.verbs import to_rows
from station.procedure import Procedures
from station.record.folder import RunRecord
from station.runner.execute import head_of
from station.safety.witness import Witnesses

GAUSSMETER = "gaussmeter"
FIELD_MT = 1.0
"""That each coil makes at least, whatever it is."""
PROCEDURE = "rlg-magnetic-sensitivity"


def main(served: Path, parent: Path, frequency_Hz: float, amplitude_A: float, *coils: str) -> None:
    coils, witness = tuple(one for one in coils if one != GAUSSMETER), GAUSSMETER in coils
    head = json.loads(served.read_text(encoding="utf-8").splitlines()[0])
    clock = RealClock(head["clock"]["speed"], head["clock"]["epoch_unix"])
    addresses = {name: one["address"] for name, one in head["instruments"].items()}
    config = Path(str(files("config")))
    plan = read_plan(config / "plans" / f"{PROCEDURE}.yaml", Procedures())
    bench = read_bench(config / "benches" / "sim.yaml", registry.names(registry.DRIVERS))
    record = RunRecord(parent, PROCEDURE, "SN-1", clock, head_of(plan, bench, clock))
    world = f"served since {head['clock']['epoch_unix']}"
    locks = InstrumentLocks(f"the run {record.path}", world)
    guardian = Guardian(
        record.path,
        None,
        addresses,
        clock,
        instruments=[*coils, "gaussmeter"],
        world=world,
        note=record.later,
        bench_file=Path(str(files("config"))) / "benches" / "sim.yaml",
    )
    found = open_instruments(bench, coils, addresses, clock, None, locks=locks)
    # Which runs of a test share, each with coils of its own.
    found |= open_instruments(bench, ["gaussmeter"], addresses, clock, None)
    for name, one in found.items():
        record.event("identified", instrument=name, **vars(one.identity))
    guardian.watch([*coils, "gaussmeter"], locks)
    witnesses, meter = Witnesses(clock), cast("Any", found[GAUSSMETER].instrument)
    if witness:
        witnesses.open({GAUSSMETER: meter})
        witnesses.informs(guardian.sees)
        for name in coils:
            witnesses.drives(name, {GAUSSMETER: FIELD_MT})
        meter.start(4.0)
    supplies: list[Any] = [found[name].instrument for name in coils]
    for supply in supplies:
        supply.programme_limits()
        supply.load_sine(frequency_Hz, amplitude_A)
    for supply in supplies:
        supply.start_sine()
    print("energised", flush=True)
    while True:
        if witness:
            witnesses.came(GAUSSMETER, to_rows(meter.drain()))
        record.event("measured", durable=False, current_A=supplies[0].current_A())
        clock.sleep(0.1)


if __name__ == "__main__":
    place, runs, frequency, amplitude, *names = sys.argv[1:]
    main(Path(place), Path(runs), float(frequency), float(amplitude), *names)
