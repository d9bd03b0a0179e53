"""`station replay`: a recorded run served back to the drivers."""

from __future__ import annotations

import json
from pathlib import Path

from station.console import tell
from station.errors import EXIT_DONE, EXIT_OUTSIDE_LIMIT
from station.replay.regression_test import write_test
from station.replay.replaying import replay
from station.speech import show


def replay_run(folder: Path, test: Path | None, *, as_json: bool) -> int:
    """Replay a run, print every deviation, and return the exit code: 1 where there is one."""
    deviations = replay(folder, tell)
    if as_json:
        print(json.dumps(deviations.to_data(), indent=1, ensure_ascii=False))
    else:
        for line in deviations.lines():
            show(line)
    if test is not None:
        write_test(folder, test)
        tell(f"regression test: {test}")
    return EXIT_DONE if deviations.none else EXIT_OUTSIDE_LIMIT
