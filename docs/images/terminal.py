"""Draw a run on a terminal as the docs show it: `PYTHONPATH=. python docs/images/terminal.py`.

A run on a served bench, much faster than real time, is watched until its second axis is measured.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from io import StringIO
from pathlib import Path

from rich.console import Console

from station.cli.attaching import begin_detached
from station.clock import RealClock, local_time
from station.control.channel import ask
from station.control.run_reader import RunReader
from station.record.series import RunSeries
from station.view.drawing import Drawing, Frame, Picture

PICTURE = Path(__file__).parent / "terminal.svg"
COLUMNS, ROWS = 100, 28
SPEED = "60"
FONTS = "Menlo, Consolas, 'DejaVu Sans Mono', monospace"
SVG = """\
<svg class="rich-terminal" viewBox="0 0 {width} {height}" xmlns="http://www.w3.org/2000/svg">
<style>
.{unique_id}-matrix {{
  font-family: FONTS; font-size: {char_height}px; line-height: {line_height}px;
  font-variant-east-asian: full-width;
}}
.{unique_id}-title {{ font-size: 18px; font-weight: bold; font-family: sans-serif; }}
{styles}
</style>
<defs>
<clipPath id="{unique_id}-clip-terminal">
<rect x="0" y="0" width="{terminal_width}" height="{terminal_height}" />
</clipPath>
{lines}
</defs>
{chrome}
<g transform="translate({terminal_x}, {terminal_y})" clip-path="url(#{unique_id}-clip-terminal)">
{backgrounds}
<g class="{unique_id}-matrix">
{matrix}
</g>
</g>
</svg>
""".replace("FONTS", FONTS)
"""As rich has it, without a font that would be fetched from elsewhere."""


def main() -> None:
    """Serve a bench, begin a run on it, and draw it."""
    os.environ.pop("CI", None)
    with tempfile.TemporaryDirectory() as place:
        first_line = Path(place) / "served.json"
        with first_line.open("w", encoding="utf-8") as output:
            command = [sys.executable, "-m", "station", "sim", "sim", "--speed", SPEED]
            served = subprocess.Popen(command, stdout=output, stderr=subprocess.PIPE, text=True)
        assert served.stderr is not None
        served.stderr.readline()
        options = ["--served", str(first_line), "--output", place, "--non-interactive"]
        run = begin_detached(["run", "rlg-magnetic-sensitivity", *options])
        try:
            frame = frame_of(run)
        finally:
            ask(run, "abort", 60.0)
            served.terminate()
            served.wait()
    shown = Console(
        record=True, width=COLUMNS, file=StringIO(), force_terminal=True, color_system="truecolor"
    )
    shown.print(frame, end="")
    shown.save_svg(str(PICTURE), title="station run", code_format=SVG, unique_id="station-terminal")


def frame_of(run: Path) -> Frame:
    """Return the picture of a run in its second unit of work."""
    reader, series = RunReader(run), RunSeries(run)
    while True:
        reader.read()
        state, live = reader.state(), reader.live()
        series.look()
        if state["units_done"] == 2 and "NA:" in live["now"]:
            times = reader.times(state["state"], live)
            picture = Picture(state, times, local_time(), live, series.of_device())
            console = Console(width=COLUMNS, height=ROWS, force_terminal=True)
            return Drawing(console, COLUMNS, ROWS).frame(picture)
        RealClock().sleep(0.2)


if __name__ == "__main__":
    main()
