"""Attack one run, watch the simulated world and what is said, and name every promise that broke.

The world, the exit code, the words, the folder and the operating system are asked; never a driver.
"""

from __future__ import annotations

import math
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from campaign_helpers import opens
from command_line import station_command
from guardian_helpers import World, world
from short_forms import BENCH, read_bench_at, short
from user_space_disk import UserSpaceDisk, user_space_disk

from campaigns.faults import Reference, reference_run
from campaigns.standstill.attacks import Scene, strike
from campaigns.standstill.cases import FAULT, GOOD, SPEEDS, TRIPPED, Case
from campaigns.standstill.runs import LOOKS_EVERY_S, Attacked, attacked_run, wait_for_step
from station.files.lookup import BENCHES, find
from station.record.layout import MANIFEST

RAMPS_BENCH_S = 15.0
"""Bench time that the ramps, a zero of the sines and the read-backs of a bench take."""
ENDS_WITHIN_S = 20.0
"""From the promised end until nothing of the run lives any more."""
NOTICED_WITHIN_S = 10.0
"""From the end or standstill of a guardian until there is another."""
GOES_ON_WITHIN_S = 45.0
"""How much later than undisturbed a run that goes on may end; it runs on a busy computer."""
RESUMES_WITHIN_S = 200.0
ENDED_BY_ITSELF = frozenset({FAULT, TRIPPED})
STAYS_S = 3.0
"""Nobody is left and the bench is not at rest for so long: it will not be any more."""
SAFE_WORDS = ("safe, read back",)
FAULTS_OF_THE_PROGRAM = ("Traceback", "a fault of the program", "MemoryError")
BUSY = ("no answer came within", "turns cannot be counted", "cannot be read")
"""What a run says that a busy computer has ended on its own: simulated instruments wait, too."""


@dataclass
class Observed:
    """What became of a run that was attacked."""

    case: Case
    speed: float
    struck: bool = False
    energised: list[str] = field(default_factory=list)
    to_rest_s: float | None = None
    """Real time from the attack until the world was at rest and stayed so."""
    to_end_s: float | None = None
    """Real time from the attack until nothing of the run lived any more."""
    to_guardian_s: float | None = None
    """Real time from the attack on a guardian until there was another."""
    exit_code: int | None = None
    words: str = ""
    events: list[str] = field(default_factory=list)
    followed: str = ""
    busy: str = ""
    """What a busy computer did to the run: what it ended with proves nothing then."""
    broken: list[str] = field(default_factory=list)


@cache
def reference_of(plan: str) -> Reference:
    """Return a run of a plan without faults on virtual time: how long its steps take."""
    with TemporaryDirectory() as place:
        return reference_run(plan, Path(place))


def attack(
    case: Case, folder: Path, *, speed: float | None = None, resume: bool = True
) -> Observed:
    """Make a run, attack it, and return what followed and what broke."""
    folder.mkdir(parents=True)
    speed = speed or SPEEDS.get(case.plan, 10.0)
    if case.attack.disk:
        with user_space_disk(folder) as disk:
            return on_bench(case, folder, disk, speed, resume)
    return on_bench(case, folder, None, speed, resume)


def on_bench(
    case: Case, folder: Path, disk: UserSpaceDisk | None, speed: float, resume: bool
) -> Observed:
    """Serve the bench, attack a run on it, and hold what is left against the promises."""
    seen = Observed(case, speed)
    reference = reference_of(case.plan)
    rng = np.random.default_rng([case.seed, *str(case).encode()])
    parent = (disk.place if disk else folder) / "runs"
    with world(folder, speed, procedure=procedure_of(case.plan)) as bench:
        with attacked_run(bench, case.plan, folder, parent, terminal=case.attack.terminal) as run:
            if not wait_for_step(run, case.step):
                seen.exit_code, seen.words = run.process.returncode, run.all_words()
                return seen
            # The beginning is seen late on a busy computer; the run's own log says when it was.
            moment_s = began_s(run, case.step) + rng.random() * step_s(reference, case.step)
            time.sleep(max(moment_s - bench.bench_s(time.time()), 0.0) / speed)
            scene = Scene(run, bench, disk, rng, energised(bench), case.attack.outage_s, [])
            if not run.alive or is_over(run):
                seen.exit_code, seen.words = run.process.returncode, run.all_words()
                return seen
            seen.struck, seen.energised = True, scene.energised
            strike(case.attack.name, scene)
            watch(seen, scene, rest_of_run_s(reference, case.step) / speed)
            judge_end(seen, scene)
        if disk is not None:
            disk.thaw()
            if case.attack.name == "folder-unmounted":
                disk.attach()
        if case.attack.resumes and resume and seen.to_rest_s is not None:
            time.sleep(max(scene.struck_s + 1.1 * case.attack.outage_s - time.time(), 0.0))
            seen.broken += go_on(seen, run, bench)
    return seen


def began_s(run: Attacked, step: str) -> float:
    """Return the bench time at which a step began."""
    began = [one for one in run.events() if one["event"] == "step-started"]
    return float(next(one["t_s"] for one in began if one["step"] == step))


def is_over(run: Attacked) -> bool:
    """Whether a run has made its bench safe: nothing can happen to it any more."""
    return any(one["event"] == "safe-state" for one in run.events())


def is_written(run: Attacked) -> bool:
    """Whether a run has written all that it leaves."""
    return run.folder is not None and (run.folder / MANIFEST).is_file()


def watch(seen: Observed, scene: Scene, rest_of_run_s: float) -> None:
    """Look at world, words and processes until nothing of the run lives, or for too long."""
    run, attack = scene.run, seen.case.attack
    ramps_s = RAMPS_BENCH_S / scene.bench.speed
    promised_s = (
        rest_of_run_s + GOES_ON_WITHIN_S if attack.within_s is None else attack.within_s + ramps_s
    )
    if attack.may_go_on:
        latest_s = max(promised_s, rest_of_run_s + GOES_ON_WITHIN_S) + ENDS_WITHIN_S
    else:
        latest_s = promised_s + ENDS_WITHIN_S
    rest_since_s: float | None = None
    nobody_since_s: float | None = None
    thawed = scene.disk is None or attack.name != "disk-frozen"
    while True:
        now_s = time.time()
        since_s = now_s - scene.struck_s
        new = run.new_words()
        at_rest = scene.bench.at_rest()
        if any(word in new for word in SAFE_WORDS) and not at_rest:
            seen.broken.append(f"a false word: the bench is not at rest at {new.strip()!r}")
        rest_since_s = (rest_since_s or now_s) if at_rest else None
        others = run.others()
        if attack.guardian and scene.has_new_guardian():
            seen.to_guardian_s = scene.to_guardian_s
        frozen_long = since_s > promised_s or (
            rest_since_s is not None
            and now_s - rest_since_s > STAYS_S
            and any(word in run.all_words() for word in SAFE_WORDS)
        )
        if not thawed and (frozen_long or not run.alive):
            assert scene.disk is not None
            scene.disk.thaw()
            thawed = True
        if attack.terminal and at_rest and run.alive and is_written(run):
            run.read_on()  # the results wait for a reader, and nothing else does
        living = run.alive or bool([pid for pid in others if pid not in scene.struck])
        nobody_since_s = None if living else nobody_since_s or now_s
        if not living and (rest_since_s or now_s - (nobody_since_s or now_s) > STAYS_S):
            seen.to_end_s = round((nobody_since_s or now_s) - scene.struck_s, 2)
            break
        if since_s > latest_s:
            break
        time.sleep(LOOKS_EVERY_S)
    if rest_since_s is not None:
        seen.to_rest_s = round(max(rest_since_s - scene.struck_s, 0.0), 2)
    if attack.within_s is not None:
        on_its_own = attack.may_go_on and run.process.poll() in GOOD
        if seen.to_rest_s is None:
            seen.broken.append(
                f"the bench is not at rest after {time.time() - scene.struck_s:.0f} s"
            )
        elif seen.to_rest_s > promised_s and not on_its_own:
            seen.broken.append(f"at rest after {seen.to_rest_s} s, promised {promised_s:.1f} s")
    elif seen.to_rest_s is None:
        seen.broken.append("the bench is not at rest at the end")


def judge_end(seen: Observed, scene: Scene) -> None:
    """Hold the exit code, the words and what is left of processes against the promises."""
    run, attack = scene.run, seen.case.attack
    code = seen.exit_code = run.process.poll()
    left = [pid for pid in run.others() if pid not in scene.struck]
    exits = attack.exits
    if attack.name.startswith("outage-") and "abort" in attack.name and steps_were_done(scene):
        exits |= GOOD
    if code is None:
        seen.broken.append("the run's process goes on for ever")
    elif code not in exits and code in ENDED_BY_ITSELF and not attack.outage_s:
        seen.busy = next((text for text in BUSY if text in run.all_words()), "")
    if code is not None and code not in exits and not seen.busy:
        seen.broken.append(f"exit code {code}, {sorted(exits)} promised")
    if left:
        seen.broken.append(f"{len(left)} processes are left behind")
    run.read_on()
    if attack.terminal:
        time.sleep(0.3)
    seen.words = run.all_words()
    seen.broken += wrong_words(seen)
    if scene.asked is not None:
        try:
            said, _ = scene.asked.communicate(timeout=60.0)
            if scene.asked.returncode != 0 and not seen.busy:
                seen.broken.append(f"station abort: exit code {scene.asked.returncode}: {said}")
        except Exception:
            scene.asked.kill()
            seen.broken.append("station abort does not end")
    if run.folder is not None:
        try:
            events = run.events()
        except (OSError, ValueError) as error:
            seen.broken.append(f"the log cannot be read: {error}")
            return
        seen.events = sorted({one["event"] for one in events})
        if attack.guardian:
            seen.broken += guardian_noticed(seen, events, left_s(scene, events))


def steps_were_done(scene: Scene) -> bool:
    """Whether all steps of a run were done when it was struck: there is nothing left to abort."""
    events = scene.run.events()
    done = [float(one["t_s"]) for one in events if one["event"] == "step-finished"]
    (began,) = [one for one in events if one["event"] == "run-started"]
    return len(done) == len(began["steps"]) and done[-1] <= scene.bench.bench_s(scene.struck_s)


def wrong_words(seen: Observed) -> Iterator[str]:
    """Yield what is wrong with what the operator reads."""
    for text in FAULTS_OF_THE_PROGRAM:
        if text in seen.words:
            yield f"the words hold {text!r}"
    code = seen.exit_code
    if code is not None and code > 0 and code not in GOOD and not seen.words.strip():
        yield f"exit code {code} without a word"


def left_s(scene: Scene, events: list[dict[str, Any]]) -> float:
    """Return the real time from the attack on a guardian until the run let its guardians go."""
    ends = [float(one["t_s"]) for one in events if one["event"] == "run-ended"]
    bench = scene.bench
    return (ends[-1] - bench.bench_s(scene.guardian_struck_s)) / bench.speed if ends else math.inf


def guardian_noticed(seen: Observed, events: list[dict[str, Any]], left_s: float) -> Iterator[str]:
    """A guardian that ends or stands still is followed by another and stands in the log."""
    if seen.to_guardian_s is None:
        if left_s > NOTICED_WITHIN_S:
            yield "there is no new guardian"
        return
    if seen.to_guardian_s > NOTICED_WITHIN_S:
        yield f"a new guardian after {seen.to_guardian_s} s, promised {NOTICED_WITHIN_S:g} s"
    if not any("guardian" in str(one["event"]) for one in events):
        yield "the log says nothing of the guardian"


def go_on(seen: Observed, run: Attacked, bench: World) -> Iterator[str]:
    """What is left opens, is analysed, and goes on to its end with the bench at rest."""
    folder = run.folder
    if folder is None:
        yield "the run folder is gone"
        return
    try:
        yield from opens(folder)
    except Exception as error:
        yield f"the folder does not open: {error!r}"
        return
    if seen.exit_code == TRIPPED:
        verb(run, "acknowledge", "sim")
    try:
        done = verb(run, "resume", folder, "--non-interactive", "--served", bench.head)
    except subprocess.TimeoutExpired:
        yield f"resume does not end within {RESUMES_WITHIN_S:g} s"
        return
    seen.followed = f"resume {done.returncode}"
    finished = done.returncode == 2 and "is finished" in done.stderr
    if any(text in done.stderr for text in BUSY):
        seen.busy = done.stderr.strip()[-300:]
    elif done.returncode not in GOOD and not finished:
        yield f"resume ended with {done.returncode}: {done.stderr.strip()[-300:]}"
    if not bench.at_rest():
        yield "the bench is not at rest after the resume"


def verb(run: Attacked, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Do a verb as the operator of a run does it; raises TimeoutExpired."""
    return subprocess.run(
        station_command(*arguments),
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=RESUMES_WITHIN_S,
        env=run.environment,
    )


def energised(bench: World) -> list[str]:
    """Return what is energised in the world now."""
    return sorted(name for name, on in bench.report()["outputs"].items() if on)


def step_s(reference: Reference, step: str) -> float:
    """Return how long a step takes undisturbed, in bench time."""
    place = reference.begins(step)
    return reference.marks[place + 1].time_s - reference.marks[place].time_s


def rest_of_run_s(reference: Reference, step: str) -> float:
    """Return how long a run takes undisturbed from the beginning of a step on, in bench time."""
    return reference.marks[-1].time_s - reference.marks[reference.begins(step)].time_s


def procedure_of(plan: str) -> str:
    """Return the procedure of a shipped plan."""
    return short(plan, read_bench_at(find(BENCHES, BENCH))).procedure
