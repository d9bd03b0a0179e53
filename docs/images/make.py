"""Draw the README's picture: run the shipped plan on the simulated bench and plot IA's spectrum.

python docs/images/make.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from procedures.rlg_magnetic_sensitivity import spectrum_plot
from station import registry
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import read_plan
from station.instruments.bench import read_bench
from station.procedure import Procedures
from station.record.folder import RunFolder
from station.report.drawing import png_of
from station.runner.evaluation import evaluate_run
from station.runner.execute import Request, execute

PICTURE = Path(__file__).parent / "spectrum.png"


def main() -> None:
    """Run the plan and write the picture beside this file."""
    plan = read_plan(find(PLANS, "rlg-magnetic-sensitivity"), Procedures())
    bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
    with tempfile.TemporaryDirectory() as parent:
        outcome = execute(Request(plan, bench, Path(parent), quiet=True, report=False))
        _, findings = evaluate_run(RunFolder(outcome.folder))
    analysis = findings.detail.analysis
    lines = [line for line in analysis.lines if line.segment == 0]
    plot = spectrum_plot.spectrum(analysis.segments[0], lines)
    PICTURE.write_bytes(png_of(plot))


if __name__ == "__main__":
    main()
