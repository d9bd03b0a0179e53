"""The picture of a run in place on a terminal, drawn again when something has changed.

A thread reads the files of the run and draws; whoever has the run waits for neither. Each frame is
one piece of text, and none is written while the terminal has not taken the one before.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, RLock, Thread

from rich.console import Console
from rich.control import Control
from rich.live import Live
from rich.segment import ControlType, Segment

from station.clock import boot_seconds, local_time
from station.control.run_reader import DAMAGE, RunReader
from station.record.series import RunSeries
from station.speech import said
from station.view.drawing import Drawing, Frame, Picture

EVERY_S = 0.5
"""Real time between two looks at the run."""
SERIES_EVERY_S, SERIES_WITHIN_S = 1.0, 0.1
"""Real time between two looks at the raw files, and for one."""
ENDS_WITHIN_S = 1.0
"""A disk that stands still keeps nobody from leaving."""
BEGIN_FRAME, END_FRAME = "\x1b[?2026h", "\x1b[?2026l"
"""What lies between is shown at once; terminals that do not know it pass over it."""


def can_draw(stream: object) -> bool:
    """Whether a stream is a terminal on which lines can be drawn again."""
    console = Console(file=stream)  # type: ignore[arg-type]
    return console.is_terminal and not console.is_dumb_terminal


class Screen:
    """One terminal that shows a run; a context, in which `say` writes lines that stay.

    `to_error`: it is drawn on standard error. `stays`: the last frame is left there.
    """

    def __init__(self, folder: Path, *, to_error: bool = True, stays: bool = False) -> None:
        self._console = Console(stderr=to_error)
        self._reader = RunReader(folder)
        self._series = RunSeries(folder)
        self._series_due_s = 0.0
        self._stays = stays
        self._live: Live | None = None
        self._frame = Frame([])
        self._size = self._console.size
        self._lock = RLock()
        self._ends = Event()
        self._thread = Thread(target=self._draw_on, name="terminal view", daemon=True)

    def __enter__(self) -> Screen:
        self._show()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        if self._thread.is_alive():
            self._thread.join(ENDS_WITHIN_S)
        self._hide()

    def begin(self) -> None:
        """Draw from now on, from a thread of its own."""
        self._thread.start()

    def look(self) -> str:
        """Read the run, draw it where it has changed, and return its state."""
        self._reader.read()
        state = self._reader.state()
        now_s = boot_seconds()
        if now_s >= self._series_due_s:
            self._series.look(SERIES_WITHIN_S)
            self._series_due_s = boot_seconds() + SERIES_EVERY_S
        live = self._reader.live()
        times = self._reader.times(state["state"], live)
        picture = Picture(state, times, local_time(), live, self._series.of_device())
        self._draw(picture)
        return str(state["state"])

    def say(self, text: str) -> None:
        """Write a line that stays, above the picture."""
        with self._lock, suppress(OSError):  # a terminal that is gone ends no run
            self._console.print(said(text), highlight=False, markup=False, soft_wrap=True)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Leave the terminal to somebody else for a while."""
        self._hide()
        try:
            yield
        finally:
            self._show()

    def _draw_on(self) -> None:
        while not self._ends.is_set():
            # What cannot be read just now, and is not yet there, is looked for again.
            with suppress(*DAMAGE):
                self.look()
            self._ends.wait(EVERY_S)

    def _draw(self, picture: Picture) -> None:
        with self._lock, suppress(OSError):
            size = self._console.size
            frame = Drawing(self._console, size.width, size.height - 1).frame(picture)
            unchanged = (size, frame) == (self._size, self._frame)
            if self._live is None or unchanged or not getattr(self._console.file, "idle", True):
                return
            with self._console:  # one piece of text
                self._console.control(code(BEGIN_FRAME))
                if size != self._size:  # lines were folded anew: nobody knows where they are
                    self._console.clear()
                self._live.update(frame, refresh=True)
                self._console.control(code(END_FRAME))
            self._size, self._frame = size, frame

    def _show(self) -> None:
        with self._lock, suppress(OSError):
            self._live = Live(
                self._frame,
                console=self._console,
                auto_refresh=False,
                transient=not self._stays,
                vertical_overflow="crop",
            )
            self._live.start()

    def _hide(self) -> None:
        with self._lock, suppress(OSError):
            live, self._live = self._live, None
            if live is not None:
                live.stop()
            self._frame = Frame([])


def code(text: str) -> Control:
    """Return a code of the terminal that moves nothing."""
    control = Control()
    control.segment = Segment(text, None, [(ControlType.CARRIAGE_RETURN,)])
    return control
