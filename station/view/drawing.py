"""One picture of a run, as lines that fit a terminal of any size from 60 x 12 on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.progress_bar import ProgressBar
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from station.console import span
from station.control.run_reader import NOTHING_LIVE, Times, sentence_of_now
from station.record.events import rest_in_words
from station.record.run_state import GOES_ON
from station.record.series import Trace
from station.speech import joined, padded, said
from station.units import shown
from station.view.marks import Marks
from station.view.sparkline import sparkline

Line = list[Segment]

WIDE, VERY_WIDE = 130, 180
"""Columns from which steps and values stand side by side, and the log beside them."""
GAP = 3
LEAST_VALUES = 56
"""Columns that titles of steps leave to values."""
LEAST_LOG = 12
"""Lines that the log may have where steps and values have fewer."""
BAR_WIDTH = 24
FEWEST_STEPS = 4
OLD_S = 30.0
"""Bench time after which a value is shown with its age."""
COLOURS = {
    "running": "green",
    "paused": "yellow",
    "evaluating": "green",
    "finished": "bold green",
    "failed": "bold red",
    "interrupted": "bold red",
}
"""They stand beside the word that says the same, as every colour here."""
STEP_COLOURS = {"done": "green", "now": "bold cyan", "waits": "dim"}
LOCK_WORDS = {"clear": "clear", "waits": "true for a moment", "tripped": "TRIPPED"}
LOCK_COLOURS = {"clear": "green", "waits": "yellow", "tripped": "bold red"}


@dataclass(frozen=True)
class Picture:
    """What is known of a run at one moment."""

    state: dict[str, Any]
    times: Times
    time_of_day: datetime
    live: dict[str, Any] = field(default_factory=lambda: NOTHING_LIVE)
    trace: Trace | None = None
    """What the device under test gave so far."""


class Frame:
    """Lines that are drawn as they are."""

    def __init__(self, lines: Sequence[Line]) -> None:
        self.lines = list(lines)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Frame) and other.lines == self.lines

    __hash__ = None  # type: ignore[assignment]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for line in self.lines:
            yield from line
            yield Segment.line()


class Drawing:
    """Draws pictures for a console; `rows` and `columns` are what may be used of it."""

    def __init__(self, console: Console, columns: int, rows: int) -> None:
        self._console = console
        self._columns, self._rows = columns, rows
        self._marks = Marks.of(console.encoding)

    def frame(self, picture: Picture) -> Frame:
        """Return the lines of a picture: at most `rows`, of at most `columns` each."""
        head = [*self._lines(self._head(picture)), []]
        foot = [line for part in bench_words(picture, self._marks) for line in self._lines(part)]
        room = max(self._rows - len(head) - len(foot), 0)
        if self._columns >= WIDE:
            body = self._side_by_side(picture, room)
        else:
            steps = sum(map(len, self._all_steps(picture, self._columns)))
            values = self._measured(picture, self._columns, room - min(steps, FEWEST_STEPS))
            body = [*self._steps(picture, self._columns, room - len(values)), *values]
        return Frame([*head, *body, *foot][: self._rows])

    def _side_by_side(self, picture: Picture, room: int) -> list[Line]:
        """Return steps as wide as their titles, values, and the log where there is room for it."""
        left = min(needed(step_rows(picture, self._marks)), self._columns - GAP - LEAST_VALUES)
        right = self._columns - GAP - left
        if self._columns < VERY_WIDE:
            values = self._measured(picture, right, room)
            return beside(self._steps(picture, left, room), values, left)
        middle = (right - GAP) * 3 // 5
        steps, values = self._steps(picture, left, room), self._measured(picture, middle, room)
        height = max(len(steps), len(values), min(room, LEAST_LOG))
        log = self._log(picture, right - GAP - middle, height)
        return beside(steps, beside(values, log, middle), left)

    def _lines(self, part: RenderableType, width: int | None = None) -> list[Line]:
        options = self._console.options.update(width=width or self._columns, height=None)
        return self._console.render_lines(part, options, pad=False)

    # What the run is, how far it is, and what it does now.

    def _head(self, picture: Picture) -> RenderableType:
        state, times = picture.state, picture.times
        colour = COLOURS[state["state"]]
        dut = state["dut"] or {}
        now = f"{picture.time_of_day:%H:%M:%S}"
        what = " ".join(str(part) for part in (dut.get("model"), dut.get("serial")) if part)
        table = Table.grid(padding=(0, 2))
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
        sentence = Text(f"{self._marks.state(state['state'])} {said(state['sentence'])}", colour)
        device = said(f"device {what or 'unknown'}")
        table.add_row(said("state"), Text.assemble(sentence, f"   {device}   {now}"))
        table.add_row(said("run"), Text(f"{state['run']}"))
        table.add_row(said("progress"), self._progress(state, times))
        table.add_row(said("time"), Text(time_words(times, picture.time_of_day)))
        table.add_row(said("now"), Text(said(sentence_of_now(state, picture.live)), "bold"))
        return table

    def _progress(self, state: dict[str, Any], times: Times) -> RenderableType:
        goes_on = state["state"] in GOES_ON
        done, planned = state["units_done"], state["units_planned"]
        of = f" of {planned}" if planned else ""
        if goes_on and (planned is None or done < planned):
            units = f"unit of work {done + 1}{of}"
        else:
            units = f"{done}{of} units of work finished"
        whole_s = times.elapsed_s + (times.left_s or 0.0)
        known = times.left_s is not None and whole_s > 0.0
        if not known and state["state"] != "finished":
            return Text(said(units))
        share = times.elapsed_s / whole_s if known else 1.0
        row = Table.grid(padding=(0, 2))
        bar = ProgressBar(
            total=1.0,
            completed=share,
            width=BAR_WIDTH,
            complete_style="cyan",
            finished_style="green",
        )
        row.add_row(bar, f"{100 * share:.0f} %", said(units))
        return row

    # The steps.

    def _all_steps(self, picture: Picture, width: int) -> list[list[Line]]:
        """Return the lines of each step; times only where they fold no title."""
        rows = step_rows(picture, self._marks)
        if needed(rows) > width and self._columns < WIDE:
            rows = [(*row[:-1], "") for row in rows]
        column_widths = widths(rows)
        lines = []
        for step, row in zip(picture.state["steps"], rows, strict=True):
            table = Table.grid(padding=(0, 1), expand=True)
            for column_width in column_widths[:3]:
                table.add_column(width=column_width)
            table.add_column(overflow="fold", ratio=1)
            if column_widths[4]:
                table.add_column(width=column_widths[4], justify="right")
            cells = row if column_widths[4] else row[:-1]
            table.add_row(*(Text(cell, STEP_COLOURS[step["state"]]) for cell in cells))
            lines.append(self._lines(table, width))
        return lines

    def _steps(self, picture: Picture, width: int, room: int) -> list[Line]:
        """Return the steps around the present one, and how many there are before and after."""
        blocks = self._all_steps(picture, width)
        states = [step["state"] for step in picture.state["steps"]]
        present = states.index("now") if "now" in states else last_index(states, "done")
        first, end = window([len(block) for block in blocks], present, room)
        left_out = {"before": first, "after": len(blocks) - end}
        more = joined(f"{count} {where}" for where, count in left_out.items() if count)
        rest = self._lines(Text(f"{self._marks.more} {more}", "dim"), width) if more else []
        return [*(line for block in blocks[first:end] for line in block), *rest]

    # What the run said last.

    def _log(self, picture: Picture, width: int, room: int) -> list[Line]:
        """Return the latest sentences of the log, the newest at the end."""
        lines: list[Line] = []
        for entry in reversed(picture.state["log"]):
            table = Table.grid(padding=(0, 2))
            table.add_column(no_wrap=True)
            table.add_column(overflow="fold")
            table.add_row(Text(clock_words(entry["t"]), "dim"), Text(said(entry["text"])))
            block = self._lines(table, width)
            if len(lines) + len(block) >= room:
                break
            lines = [*block, *lines]
        return [*self._lines(Text(said("log"), "bold"), width), *lines] if lines else []

    # Set-points beside read-backs, interlocks, and what the device gives.

    def _measured(self, picture: Picture, width: int, room: int) -> list[Line]:
        # Once the bench was made safe what was read before is of no use: it shows what flowed then.
        live = NOTHING_LIVE if picture.state["safe"] else picture.live
        locks = self._locks(live["interlocks"], width)
        trace = self._trace(picture.trace, width) if picture.trace else []
        fixed = [*locks, *trace]
        instruments = live["instruments"]
        if not instruments:
            return fixed[: max(room, 0)]
        values = self._values(instruments, width, room - len(fixed))
        return [*values, *fixed][: max(room, 0)]

    def _values(self, instruments: Sequence[dict[str, Any]], width: int, room: int) -> list[Line]:
        """Return a line for each value where there is room, else one or two for an instrument."""
        name_width = max(cell_len(said(instrument["instrument"])) for instrument in instruments)
        both = width - name_width - 4
        read_need = max(
            cell_len(words) for each in instruments for words in (*value_words(each["read"]), "")
        )
        set_most = both * 2 // 5 if self._columns < WIDE else max(both * 2 // 5, both - read_need)
        set_width = min(
            max(cell_len(said(instrument["set"])) for instrument in instruments), set_most
        )
        set_width = max(set_width, cell_len(said("set")))
        read_width = both - set_width

        def line(name: str, set_: str, read: str, style: str = "") -> list[Line]:
            table = Table.grid(padding=(0, 2))
            table.add_column(width=name_width, overflow="fold")
            table.add_column(width=set_width, overflow="fold")
            table.add_column(width=read_width, overflow="fold")
            table.add_row(*(Text(cell, style) for cell in (said(name), said(set_), read)))
            return self._lines(table, width)

        heading = line("instrument", "set", said("read back"), "bold")
        room -= len(heading)
        most = 2 if room >= 2 * len(instruments) else 1

        def blocks_of(words: Callable[[Sequence[dict[str, Any]]], str]) -> list[list[Line]]:
            return [
                line(each["instrument"], each["set"] or "-", words(each["read"]))
                for each in instruments
            ]

        blocks = blocks_of(one_a_line) if self._columns >= WIDE else []
        if not blocks or sum(map(len, blocks)) > room:
            blocks = blocks_of(lambda read: read_words(read, most * read_width))
        first, end = window([len(block) for block in blocks], 0, room)
        left = len(blocks) - (end - first)
        after = (
            self._lines(Text(said(f"{self._marks.more} {left} more"), "dim"), width) if left else []
        )
        return [*heading, *(line for block in blocks[first:end] for line in block), *after]

    def _locks(self, interlocks: Sequence[dict[str, str]], width: int) -> list[Line]:
        """Return the interlocks by state; beside the steps those that are clear are named, too."""
        table = Table.grid(padding=(0, 2))
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
        name = said("interlocks")
        for state in ("tripped", "waits", "clear"):
            those = [interlock for interlock in interlocks if interlock["state"] == state]
            if those:
                named = state != "clear" or width != self._columns
                which = joined(map(lock_words, those)) if named else str(len(those))
                sentence = said(f"{self._marks.lock(state)} {LOCK_WORDS[state]}: {which}")
                table.add_row(name, Text(sentence, LOCK_COLOURS[state]))
                name = ""
        return self._lines(table, width) if interlocks else []

    def _trace(self, trace: Trace, width: int) -> list[Line]:
        last, low, high = (
            shown(value, trace.unit)
            for value in (trace.values[-1], min(trace.values), max(trace.values))
        )
        sentence = f"{trace.source} {trace.quantity}: {last}, from {low} to {high} so far"
        drawn = sparkline(trace.values, width, self._marks.levels)
        return [*self._lines(Text(said(sentence)), width), *self._lines(Text(drawn, "cyan"), width)]


def step_rows(picture: Picture, marks: Marks) -> list[tuple[str, ...]]:
    """Return mark, state, number, title and time of each step."""
    return [
        (
            marks.step(step["state"]),
            padded(step["state"], max(cell_len(said(state)) for state in STEP_COLOURS)),
            step["number"],
            said(step["title"]),
            step_time(step, picture.times.elapsed_s),
        )
        for step in picture.state["steps"]
    ]


def step_time(step: dict[str, Any], now_s: float) -> str:
    """Return how long a step took, or about how long it will take; nothing for no time."""
    took_s, expected_s, began_s = step["took_s"], step["expected_s"], step["began_s"]
    if took_s is None and began_s is not None:
        expected_s = max(now_s - began_s, expected_s or 0.0)
    time_s = expected_s if took_s is None else took_s
    if time_s is None or round(time_s) < 1:
        return ""
    return span(time_s) if took_s is not None else f"~{span(time_s)}"


def widths(rows: Sequence[Sequence[str]]) -> list[int]:
    """Return the width of each column of rows."""
    return [max(map(cell_len, column)) for column in zip(*rows, strict=True)]


def needed(rows: Sequence[Sequence[str]]) -> int:
    """Return the columns of a terminal that rows need, a blank between each two cells."""
    return sum(widths(rows)) + len(rows[0]) - 1 if rows else 0


def clock_words(time_s: float) -> str:
    """Return a run time as a clock shows it: `0:18:05`."""
    minutes, seconds = divmod(round(time_s), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{seconds:02d}"


def bench_words(picture: Picture, marks: Marks) -> Iterator[Text]:
    """Yield how the bench was left; nothing before it was made safe."""
    safe = picture.state["safe"]
    if not safe:  # not made safe yet, or nothing that can harm
        return
    verified, sentence = rest_in_words(safe, picture.state["left_out"])
    mark, colour = (marks.good, "green") if verified else (marks.bad, "bold red")
    yield Text(f"{mark} {said(sentence)}", colour)


def time_words(times: Times, now: datetime) -> str:
    """Return elapsed and left bench time, the time of day of the end."""
    parts = [f"elapsed {span(times.elapsed_s)}"]
    if times.left_s is not None:
        parts.append(f"left about {span(times.left_s)}")
    if times.ends is not None:
        ends = times.ends.astimezone(now.tzinfo)
        day = "" if ends.date() == now.date() else f"{ends.strftime(said('%a %d %b'))} "
        soon = ends - now < timedelta(days=300)
        parts.append(f"ends about {day if soon else f'{ends:%Y-%m-%d} '}{ends:%H:%M}")
    return joined(parts)


def read_words(read: Sequence[dict[str, Any]], room: int) -> str:
    """Return values as they were read, in `room` characters, numbers before states.

    What there is no room for is counted.
    """
    parts = value_words(read)
    for kept in range(len(parts), 0, -1):
        more = len(parts) - kept
        line = joined((*parts[:kept], f"+{more}") if more else parts[:kept])
        if cell_len(line) <= room:
            return line
    return parts[0] if parts else "-"


def one_a_line(read: Sequence[dict[str, Any]]) -> str:
    """Return values as they were read, each on a line of its own."""
    return "\n".join(value_words(read)) or "-"


def value_words(read: Sequence[dict[str, Any]]) -> list[str]:
    """Return each value as it was read, with its age, numbers before states."""
    ordered = sorted(
        read, key=lambda entry: not entry["text"][-1:].isalpha() or " " not in entry["text"]
    )
    return [
        f"{said(entry['quantity'])} {said(entry['text'])}{said(age_words(entry['age_s']))}"
        for entry in ordered
    ]


def age_words(age_s: float) -> str:
    """Return in short how old a value is, nothing where it is new."""
    if age_s <= OLD_S:
        return ""
    units = (("h", 3600.0), ("min", 60.0), ("s", 1.0))
    unit, size_s = next(unit_size for unit_size in units if age_s >= unit_size[1])
    return f" ({age_s / size_s:.0f} {unit} ago)"


def lock_words(interlock: dict[str, str]) -> str:
    """Return the name of an interlock, and what it says where it is not clear."""
    return (
        said(interlock["name"])
        if interlock["state"] == "clear"
        else f"{said(interlock['name'])} ({said(interlock['said'])})"
    )


def beside(left: Sequence[Line], right: Sequence[Line], left_width: int) -> list[Line]:
    """Return two columns of lines as one; `left_width` is that of the left column."""
    lines = []
    for n in range(max(len(left), len(right))):
        first = left[n] if n < len(left) else []
        blank = Segment(" " * (left_width - Segment.get_line_length(first) + GAP))
        lines.append([*first, blank, *right[n]] if n < len(right) else list(first))
    return lines


def window(heights: Sequence[int], focus: int, room: int) -> tuple[int, int]:
    """Return first and end of the blocks around `focus` that fit into `room` lines.

    Where not all of them do, a line is kept free that says how many are left out.
    """
    if sum(heights) <= room:
        return 0, len(heights)
    room -= 1
    if heights[focus] > room:
        return focus, focus
    first, end, used = focus, focus + 1, heights[focus]
    while True:
        # What comes next matters more than what is over; one that is over is always shown.
        after, before = end, first - 1
        for at in (after, before) if end - focus <= focus - first else (before, after):
            if 0 <= at < len(heights) and used + heights[at] <= room:
                first, end = min(first, at), max(end, at + 1)
                used += heights[at]
                break
        else:
            return first, end


def last_index(states: Sequence[str], state: str) -> int:
    """Return where a state stands last; 0 where it does not."""
    return max((n for n, other in enumerate(states) if other == state), default=0)
