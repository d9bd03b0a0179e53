"""Replay a run: the same plan, bench and drivers, with its transcript in place of instruments."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from station import registry
from station.errors import EXIT_ABORTED, Aborted, InputError
from station.instruments.bench import bench_of
from station.instruments.trace import FOLDER
from station.record.events import Event
from station.record.folder import RunFolder, read_run
from station.record.layout import MANIFEST, file_hash
from station.recorded import read_plan_and_bench
from station.replay.deviations import Deviations
from station.replay.lines import changed_lines
from station.replay.transcript import Transcript, read_transcripts
from station.replay.wire import ReplayClock
from station.runner.execute import Request, execute

END_S = 2.0
"""What an abort cuts off lies this close to it: nobody ends the same run at the same instant."""
ANSWERED = "prompt"


class RecordedPlace:
    """Where every instrument of a recorded run is: on virtual time, at its transcript."""

    def __init__(
        self, folder: RunFolder, transcripts: Mapping[str, Transcript], deviations: Deviations
    ) -> None:
        self.clock = ReplayClock(transcripts, deviations)
        self.addresses = {
            name: address_of(name, transcript.address) for name, transcript in transcripts.items()
        }
        self.answers = {
            str(event.details["id"]): str(event.details["answer"])
            for event in folder.events_of(ANSWERED)
        }

    def act(self, prompt_id: str) -> str:
        """Return what was answered to a prompt."""
        return self.answers.get(prompt_id, "done")


def address_of(name: str, address: str) -> str:
    """Return an address of the same kind that names the instrument: several may share a line."""
    if "://" in address:
        scheme, _, rest = address.partition("://")
        _, slash, path = rest.partition("/")
        return f"{scheme}://{name}:1{slash}{path}"
    if address.lower().endswith("::socket"):
        return f"TCPIP::{name}::1::SOCKET"
    return f"ASRL/replay/{name}::INSTR" if address else ""


def replay(path: Path, say: Callable[[str], None] = lambda text: None) -> Deviations:
    """Serve a run's transcript to the drivers, and return what they do differently.

    Of a run that was resumed its first process is replayed. Raises InputError where the folder
    holds no transcript.
    """
    folder = read_run(path)
    transcripts = read_transcripts(path)
    deviations = Deviations(altered=altered(path))
    place = RecordedPlace(folder, transcripts, deviations)
    plan, recorded = read_plan_and_bench(folder)
    bench = bench_of(recorded.document, registry.names(registry.DRIVERS), bounded=True)
    failed = next(folder.events_of("failed"), None)
    aborted = failed if failed and failed.details.get("exit_code") == EXIT_ABORTED else None
    if aborted is not None:
        abort_at(place.clock, aborted)
    with TemporaryDirectory(prefix="station-replay-") as output:
        request = Request(
            plan,
            bench,
            Path(output),
            answers=dict.fromkeys(place.answers, "done"),
            quiet=True,
            report=False,
            replay=place,
        )
        outcome = execute(request)
    if outcome.error is not None:
        say(f"the replayed run ended early: {outcome.error}")
    place.clock.finish()
    forgive_the_end(deviations, aborted, transcripts)
    return deviations


def abort_at(clock: ReplayClock, event: Event) -> None:
    """End the replayed run when a person ended the recorded one."""

    def step() -> None:
        clock.interrupt(Aborted(str(event.details["message"])))

    clock.repeat("the recorded abort", event.time_s, step)


def forgive_the_end(
    deviations: Deviations, aborted: Event | None, transcripts: Mapping[str, Transcript]
) -> None:
    """Leave out what only the end of a run that was aborted or killed makes different."""
    around_s = aborted.time_s if aborted else deviations.ended_s
    if around_s is not None:
        deviations.differences = [
            deviation
            for deviation in deviations.differences
            if abs(deviation.time_s - around_s) > END_S
        ]


def altered(path: Path) -> list[str]:
    """Return in sentences what of the transcripts is not as it was recorded: files, and lines."""
    named = [
        sentence
        for transcript in sorted((path / FOLDER).glob("*.txt"))
        for sentence in changed_lines(transcript)
    ]
    manifest = path / MANIFEST
    if not manifest.is_file():
        return named
    try:
        files = json.loads(manifest.read_text(encoding="utf-8"))["files"]
    except (ValueError, KeyError) as error:
        raise InputError(f"{manifest} cannot be read: {error}") from error
    sentences = []
    for name, known in files.items():
        if not name.startswith(f"{FOLDER}/"):
            continue
        instrument = Path(name).stem
        if not (path / name).is_file():
            sentences.append(f"{instrument}: {name} was recorded and is lost")
        elif file_hash(path / name) != known:
            sentences.append(f"{instrument}: {name} was changed since it was recorded")
    return [*sentences, *named]
