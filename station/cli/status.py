"""`station status`."""

from __future__ import annotations

import json
from pathlib import Path

from station.console import span
from station.control.status import SENTENCES, Status, newest_run, read_status
from station.record.guardian_log import whole_bench

RUNS = Path("runs")
MOST_UNITS = 6


def print_status(run: Path | None, *, as_json: bool) -> None:
    """Print how a run stands; without one, the newest below `runs`."""
    status = read_status(newest_run(RUNS) if run is None else run)
    if as_json:
        print(json.dumps(status.to_data(), indent=1, ensure_ascii=False))
        return
    for name, text in rows(status):
        print(f"{name:<16}{text}")


def rows(status: Status) -> list[tuple[str, str]]:
    """Return what there is to say, a name and a text each."""
    dut = status.dut
    done = len(status.units_finished)
    of = "" if status.units_planned is None else f" of {status.units_planned}"
    shown = ", ".join(status.units_finished[-MOST_UNITS:])
    listed = f" ({'… ' if done > MOST_UNITS else ''}{shown})" if done else ""
    found = [
        ("run", status.run),
        ("procedure", status.procedure or "unknown"),
        ("device", f"{dut['model']} {dut['serial']}" if dut else "unknown"),
        ("state", SENTENCES[status.state]),
        ("step", f"{status.step}  {status.step_title}" if status.step else "none yet"),
        ("units of work", f"{done}{of} finished{listed}"),
        ("run time", span(status.run_time_s)),
    ]
    if status.state in ("running", "paused") and status.remaining_s is not None:
        found.append(("bench time left", f"about {span(status.remaining_s)}"))
    if status.bench_safe is not None:
        whole = whole_bench(status.left_out).removeprefix("the bench is ")
        found.append(("bench", whole if status.bench_safe else "NOT VERIFIED as safe"))
    elif status.state == "interrupted":
        found.append(("bench", "NOT made safe by the run itself; look at it now"))
    found.append(("last message", status.message))
    return found
