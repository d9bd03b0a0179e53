"""When a run stood still between two units of work, from its log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from station.record.events import Event

PAUSED, WENT_ON = "paused", "went-on"
ENDS = ("failed", "safe-state", "run-ended")
"""What ends a pause too: the run itself ends."""


def spans(events: Sequence[Event], now_s: float) -> Iterator[tuple[float, float]]:
    """Yield begin and end of each pause, s of run time; one that lasts ends at `now_s`."""
    began_s: float | None = None
    for event in events:
        if event.kind == PAUSED:
            began_s = event.time_s
        elif began_s is not None and event.kind in (WENT_ON, *ENDS):
            yield began_s, event.time_s
            began_s = None
    if began_s is not None:
        yield began_s, max(now_s, began_s)


def is_paused(events: Sequence[Event]) -> bool:
    """Whether the log of a run that goes on ends in a pause."""
    told = [event.kind for event in events if event.kind in (PAUSED, WENT_ON, *ENDS)]
    return bool(told) and told[-1] == PAUSED


def paused_s(events: Sequence[Event], since_s: float, now_s: float) -> float:
    """Return how much of the run time from `since_s` to `now_s` was spent paused, in s."""
    ended = (one for one in spans(events, now_s) if one[1] > since_s)
    return sum(end_s - max(began_s, since_s) for began_s, end_s in ended)
