"""Pause, abort and status from another terminal: heard by the run, acknowledged, or refused."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread, Timer
from threading import enumerate as enumerate_threads
from typing import Any, TextIO

import pytest
from campaign_helpers import shipped, undirected_run, whole_events
from guardian_helpers import until
from user_space_disk import disk_or_skip

from sim_instruments.bench import SimulatedBench
from station import registry
from station.cli import controlling
from station.clock import Clock, RealClock, VirtualClock
from station.control.channel import MAX_ADDRESS, Channel, NotRunning, ask, go_on, places
from station.control.questions import Operator
from station.control.requests import ENDS_ALREADY, RECEIVED, Control
from station.control.signals import AbortSignals
from station.control.status import read_status
from station.errors import EXIT_ABORTED, Aborted, InterlockTripped, PauseRefused, RecordError
from station.instruments.opening import InstrumentPlace
from station.panel.run_requests import RunRequests
from station.procedure import Prompt
from station.record.folder import RunRecord
from station.runner.progress import Progress
from station.runner.run import ActingRun

LIMITS = {"current": 8.0, "voltage": 30.0, "slew": 2.0, "zero_current": 0.02}
LONG_S = 20.0
CLOSES_WITHIN_S = 10.0


@dataclass
class Desk:
    """A run that other terminals can reach, and what those were answered."""

    run: ActingRun
    control: Control
    answers: list[dict[str, Any]] = field(default_factory=list)
    terminals: list[Thread] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        return self.run.record.path

    @property
    def events(self) -> list[dict[str, Any]]:
        return whole_events(self.folder)

    def ask(self, request: str) -> Event:
        """Ask from another thread; the event comes once the run has heard it."""
        heard = Event()

        def terminal() -> None:
            answer = ask(self.folder, request, LONG_S, meanwhile=lambda _: heard.set())
            self.answers.append(answer)
            heard.set()

        self.at_terminal(terminal)
        return heard

    def at_terminal(self, body: Callable[[], None]) -> None:
        """Do something in another thread."""
        thread = Thread(target=body)
        thread.start()
        self.terminals.append(thread)

    def once_paused(self, body: Callable[[], object]) -> None:
        """Do something from another thread as soon as the run is paused."""

        def wait_first() -> None:
            while not ask(self.folder, "status")["paused"]:
                pass
            body()

        self.at_terminal(wait_first)

    def wait_for_answers(self) -> list[dict[str, Any]]:
        for thread in self.terminals:
            thread.join(LONG_S)
        return self.answers


@contextmanager
def desk(parent: Path, clock: Clock) -> Iterator[Desk]:
    record = RunRecord(parent, "some-procedure", "SN-1", clock)
    try:
        with clock.participant("run"), Progress(1.0, quiet=True) as progress:
            run = undirected_run(clock, record, progress)  # type: ignore[arg-type]
            with Control(record.path, clock) as control:
                yield Desk(run, control)
    finally:
        clock.stop()
        record.close()
        record.seal()


@pytest.fixture
def virtual(tmp_path: Path) -> Iterator[Desk]:
    with desk(tmp_path / "runs", VirtualClock()) as made:
        yield made


@pytest.fixture
def real(tmp_path: Path) -> Iterator[Desk]:
    with desk(tmp_path / "runs", RealClock(speed=10.0)) as made:
        yield made


@pytest.fixture
def supply(virtual: Desk) -> Iterator[Any]:
    """A simulated coil supply that the run has opened."""
    clock, bench = virtual.run.clock, shipped("benches", "sim")
    simulated = SimulatedBench(bench, clock, "rlg-magnetic-sensitivity")
    name = "coil_supply.x"
    entry, address = bench["instruments"][name], simulated.instruments[name]["address"]
    place = InstrumentPlace(name, address, clock, entry["settings"], LIMITS)
    opened = registry.load(registry.DRIVERS, entry["driver"])(place)
    virtual.run.instruments = {name: opened}
    yield opened
    opened.close()
    simulated.close()


class Chamber:
    """An instrument that can wait by itself, or says why it cannot."""

    def __init__(self, refuses: str = "") -> None:
        self.refuses = refuses
        self.asked = 0

    def pause(self) -> str:
        self.asked += 1
        if self.refuses:
            raise PauseRefused(self.refuses)
        return "holds 20 degC"


def kinds(desk: Desk) -> list[str]:
    return [event["event"] for event in desk.events]


def test_only_the_user_can_open_the_channel(virtual: Desk) -> None:
    (place,) = [one for one in places(virtual.folder) if one.key() is not None]
    files = [place.key_file, Path(place.address)]
    assert [stat.S_IMODE(path.stat().st_mode) for path in files] == [0o600, 0o600]
    assert stat.S_IMODE(place.key_file.parent.stat().st_mode) == 0o700
    with pytest.raises(AuthenticationError):
        Client(place.address, place.family, authkey=b"a guess")
    assert ask(virtual.folder, "status")["outcome"] == "status"
    virtual.control.__exit__(None, None, None)
    assert not any(path.exists() for path in files)
    assert not [thread for thread in enumerate_threads() if thread.name.startswith("control")]


def test_a_folder_that_others_can_open_is_closed_to_them_or_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    open_to_all = tmp_path / "x" / "inertial-station"
    open_to_all.mkdir(parents=True)
    open_to_all.chmod(0o777)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "x"))
    first = next(places(tmp_path))
    if first.key_file.parent == open_to_all:  # else its path is too long for a socket here
        assert first.key() is None
        first.prepare()
        assert stat.S_IMODE(open_to_all.stat().st_mode) == 0o700
        assert first.key() is not None
    (tmp_path / "y").mkdir()
    (tmp_path / "y" / "inertial-station").symlink_to(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "y"))
    linked = next(places(tmp_path))
    if linked.key_file.parent.is_symlink():
        with pytest.raises(PermissionError, match="another user"):
            linked.prepare()


def test_the_address_is_short_wherever_the_folders_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = tmp_path / ("f" * 120)
    far.mkdir()
    for name in ("XDG_RUNTIME_DIR", "XDG_STATE_HOME"):
        monkeypatch.setenv(name, str(far))
    with desk(far / "runs", VirtualClock()) as made:
        assert ask(made.folder, "status")["paused"] is False
        addresses = [place.address for place in places(made.folder)]
    assert all(len(os.fsencode(address)) <= MAX_ADDRESS for address in addresses)


@pytest.mark.skipif(sys.platform != "linux", reason="a disk is frozen on Linux")
def test_a_disk_that_hangs_below_the_channel_holds_up_no_end_of_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with disk_or_skip(tmp_path) as disk:
        runtime = disk.place / "r"
        runtime.mkdir()
        with TemporaryDirectory(prefix="s", dir="/tmp") as short:
            near = Path(short) / "r"
            near.symlink_to(runtime)
            monkeypatch.setenv("XDG_RUNTIME_DIR", str(near))
            channel = Channel(tmp_path, lambda asked: None)
            assert channel.place.key_file.is_relative_to(near)
            ends = Thread(target=channel.close, daemon=True)
            disk.freeze()
            ends.start()
            ends.join(CLOSES_WITHIN_S)
            held_up = ends.is_alive()
            disk.thaw()
            ends.join()
            assert not held_up
            until(lambda: not channel.place.key_file.exists())


def test_what_a_dead_process_left_is_replaced(tmp_path: Path) -> None:
    clock = VirtualClock()
    record = RunRecord(tmp_path, "some-procedure", "SN-1", clock)
    code = (
        "import os, sys; from pathlib import Path; from station.control.channel import Channel; "
        "Channel(Path(sys.argv[1]), print); os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", code, str(record.path)], check=False)
    (left,) = [one for one in places(record.path) if one.key() is not None]
    before = left.key()
    with Control(record.path, clock):
        assert ask(record.path, "status")["outcome"] == "status"
        assert left.key() != before
    record.close()
    record.seal()


def test_a_run_that_nobody_runs_says_how_to_go_on(virtual: Desk) -> None:
    folder = virtual.folder
    virtual.control.__exit__(None, None, None)
    virtual.run.record.event("run-ended", complete=False)
    virtual.run.record.close()
    virtual.run.record.seal()
    with pytest.raises(NotRunning, match=rf"not running .*`station resume {folder}` resumes it"):
        ask(folder, "pause")
    assert not go_on(folder)


def test_a_run_that_just_begins_is_waited_for(virtual: Desk, tmp_path: Path) -> None:
    begins = tmp_path / "begins"
    begins.mkdir()
    events = (virtual.folder / "events.jsonl").read_bytes()
    (begins / "events.jsonl").touch()
    (begins / "run.lock").touch()
    asked = Event()
    writes = Timer(0.2, lambda: (asked.set(), (begins / "events.jsonl").write_bytes(events)))
    writes.start()
    with pytest.raises(NotRunning):
        ask(begins, "pause")
    assert asked.is_set()


def test_somebody_who_connects_and_says_nothing_keeps_nobody_from_being_heard(
    virtual: Desk,
) -> None:
    (place,) = [one for one in places(virtual.folder) if one.key() is not None]
    with Client(place.address, place.family):
        assert ask(virtual.folder, "status")["outcome"] == "status"
    assert ask(virtual.folder, "dance")["outcome"] == "unknown"


def test_a_run_at_rest_pauses_and_goes_on_at_the_same_instant_of_virtual_time(
    virtual: Desk, supply: Any
) -> None:
    supply.programme_limits()
    assert virtual.ask("pause").wait(LONG_S)
    virtual.once_paused(lambda: go_on(virtual.folder))
    began_s = virtual.run.clock.now()
    virtual.control.between_units(virtual.run)
    (answer,) = virtual.wait_for_answers()
    assert answer["outcome"] == "paused"
    assert answer["devices"]["coil_supply.x"].startswith("output off, ")
    assert virtual.run.clock.now() - began_s < 1.0  # what asking the supply took
    assert kinds(virtual) == ["pause-requested", "paused", "went-on"]
    assert virtual.events[-1]["paused_s"] == 0.0
    virtual.control.between_units(virtual.run)
    assert kinds(virtual) == ["pause-requested", "paused", "went-on"]


def test_a_pause_with_a_coil_switched_on_is_refused_by_its_name(virtual: Desk, supply: Any) -> None:
    supply.programme_limits()
    supply.load_sine(0.1, 1.0)
    supply.start_sine()
    chamber = Chamber()
    virtual.run.instruments = {**virtual.run.instruments, "thermal_chamber": chamber}
    assert virtual.ask("pause").wait(LONG_S)
    virtual.control.between_units(virtual.run)
    (answer,) = virtual.wait_for_answers()
    assert answer["outcome"] == "refused"
    assert "not at rest: output on, list running" in answer["devices"]["coil_supply.x"]
    assert kinds(virtual) == ["pause-requested", "pause-refused"]
    assert chamber.asked == 0
    supply.stop()


def test_an_instrument_that_can_wait_by_itself_says_how(virtual: Desk) -> None:
    virtual.run.instruments = {"thermal_chamber": Chamber(), "gaussmeter": object()}
    assert virtual.ask("pause").wait(LONG_S)
    virtual.once_paused(lambda: go_on(virtual.folder))
    virtual.control.between_units(virtual.run)
    (answer,) = virtual.wait_for_answers()
    assert answer["devices"] == {"thermal_chamber": "holds 20 degC"}


def test_one_instrument_that_refuses_lets_the_run_go_on(virtual: Desk) -> None:
    reason = "thermal_chamber: it is on a ramp"
    virtual.run.instruments = {"turntable": Chamber(), "thermal_chamber": Chamber(reason)}
    assert virtual.ask("pause").wait(LONG_S)
    virtual.control.between_units(virtual.run)
    (answer,) = virtual.wait_for_answers()
    assert (answer["outcome"], answer["devices"]) == ("refused", {"thermal_chamber": reason})


def test_everybody_who_asks_for_a_pause_is_told(virtual: Desk) -> None:
    assert virtual.ask("pause").wait(LONG_S)
    assert virtual.ask("pause").wait(LONG_S)

    def once_more() -> None:
        virtual.answers.append(ask(virtual.folder, "pause"))
        go_on(virtual.folder)

    virtual.once_paused(once_more)
    virtual.control.between_units(virtual.run)
    assert [one["outcome"] for one in virtual.wait_for_answers()] == ["paused"] * 3
    assert kinds(virtual).count("paused") == 1


def test_who_leaves_has_taken_the_pause_back(virtual: Desk) -> None:
    with pytest.raises(Exception, match="does not answer"):
        ask(virtual.folder, "pause", 0.0)
    while ask(virtual.folder, "status")["pause_requested"]:
        pass
    virtual.control.between_units(virtual.run)
    assert kinds(virtual) == []


def test_to_go_on_takes_a_pause_back_that_has_not_come_yet(virtual: Desk) -> None:
    assert not go_on(virtual.folder)
    assert virtual.ask("pause").wait(LONG_S)
    assert go_on(virtual.folder)
    (answer,) = virtual.wait_for_answers()
    assert (answer["outcome"], controlling.EXITS[answer["outcome"]]) == ("withdrawn", EXIT_ABORTED)
    assert answer["said"] == "somebody let the run go on before the pause came"
    virtual.control.between_units(virtual.run)
    assert kinds(virtual) == []


def test_a_pause_in_the_last_unit_is_answered_that_the_run_ends_first(virtual: Desk) -> None:
    assert virtual.ask("pause").wait(LONG_S)
    virtual.control.hold()
    (answer,) = virtual.wait_for_answers()
    assert (answer["outcome"], answer["said"]) == ("ended", "the run ends first")
    assert ask(virtual.folder, "pause")["outcome"] == "ended"


@pytest.mark.parametrize("left", [["IA"], []], ids=["in the last unit", "after it"])
def test_a_pause_that_can_not_come_any_more_is_answered_at_once(
    virtual: Desk, left: list[str]
) -> None:
    run, word = virtual.run, RunRequests()
    run.progress = Progress(1.0, units={"warm-up": 1.0, "IA": 1.0}, quiet=True)
    run.listen_to(virtual.control)
    run.progress.unit_finished("warm-up")
    assert virtual.ask("pause").wait(LONG_S)
    assert go_on(virtual.folder)  # it would come before IA
    run.may_pause()
    if not left:
        run.progress.unit_finished("IA")
    for said in (ask(virtual.folder, "pause"), word.pass_on(virtual.folder, "pause", {})):
        assert (said["outcome"], said["final"]) == ("ended", True)
        assert "no pause comes" in said["said"]
    assert not ask(virtual.folder, "live")["pause_requested"]


def test_a_run_of_which_data_decide_the_units_may_always_pause(virtual: Desk) -> None:
    virtual.run.listen_to(virtual.control)
    virtual.run.may_pause()
    assert virtual.ask("pause").wait(LONG_S)
    assert ask(virtual.folder, "live")["pause_requested"]


def test_an_abort_ends_the_run_at_its_next_wait(virtual: Desk) -> None:
    assert ask(virtual.folder, "abort")["said"] == RECEIVED
    with pytest.raises(Aborted, match="ended by `station abort`"):
        virtual.run.clock.sleep(1.0)


def test_an_abort_that_comes_while_the_bench_is_made_safe_interrupts_nothing(
    virtual: Desk,
) -> None:
    with AbortSignals(virtual.run.clock) as signals:
        virtual.control.hold()
        assert signals.hold() is None
        assert ask(virtual.folder, "abort")["said"] == ENDS_ALREADY
        virtual.run.clock.sleep(1.0)


def test_an_abort_that_no_wait_has_taken_up_is_not_lost(virtual: Desk) -> None:
    assert ask(virtual.folder, "abort")["outcome"] == "ending"
    with AbortSignals(virtual.run.clock) as signals:
        virtual.control.hold()
        assert isinstance(signals.hold(), Aborted)
        virtual.run.clock.sleep(1.0)


@pytest.mark.parametrize("name", ["virtual", "real"])
def test_an_abort_ends_a_pause(name: str, request: pytest.FixtureRequest) -> None:
    made: Desk = request.getfixturevalue(name)
    assert made.ask("pause").wait(LONG_S)
    made.once_paused(lambda: ask(made.folder, "abort"))
    with pytest.raises(Aborted, match="ended by `station abort`"):
        made.control.between_units(made.run)
    assert ask(made.folder, "status")["paused"] is False


@pytest.mark.parametrize("name", ["virtual", "real"])
def test_ctrl_c_ends_a_pause(name: str, request: pytest.FixtureRequest) -> None:
    made: Desk = request.getfixturevalue(name)
    assert made.ask("pause").wait(LONG_S)
    made.once_paused(lambda: os.kill(os.getpid(), signal.SIGINT))
    with (
        AbortSignals(made.run.clock),
        pytest.raises(Aborted, match="ended by Ctrl-C"),
    ):
        made.control.between_units(made.run)


def test_an_interlock_that_trips_ends_a_pause(real: Desk) -> None:
    trip = InterlockTripped("hot", "gyro_acquisition: temperature is 80 degC", 1.0)
    assert real.ask("pause").wait(LONG_S)
    real.once_paused(lambda: real.run.clock.interrupt(trip))
    with pytest.raises(InterlockTripped, match="the interlock hot tripped"):
        real.control.between_units(real.run)


class Keyboard:
    """A terminal at which nobody types; it says when it is read."""

    def __init__(self, file: TextIO) -> None:
        self.read = Event()
        self._file = file

    def isatty(self) -> bool:
        return False

    def readline(self) -> str:
        self.read.set()
        return self._file.readline()


def test_an_abort_ends_a_prompt(virtual: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    nobody_types, keys = os.pipe()
    operator = Operator(virtual.run.clock, {}, interactive=True, act=None)
    with os.fdopen(nobody_types, encoding="utf-8") as file, os.fdopen(keys, "wb"):
        keyboard = Keyboard(file)
        monkeypatch.setattr(sys, "stdin", keyboard)
        virtual.at_terminal(lambda: keyboard.read.wait(LONG_S) and ask(virtual.folder, "abort"))
        with (
            AbortSignals(virtual.run.clock),
            pytest.raises(Aborted, match="ended by `station abort`"),
        ):
            operator.ask(Prompt("mount", "Mount the gyro."))


def test_an_interlock_or_a_lost_folder_ends_a_prompt_and_says_so(
    real: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = real.run.clock
    nobody_types, keys = os.pipe()
    with os.fdopen(nobody_types, encoding="utf-8") as file, os.fdopen(keys, "wb"):
        monkeypatch.setattr(sys, "stdin", keyboard := Keyboard(file))
        operator = Operator(clock, {}, interactive=True, act=None)
        operator.record_in(real.run.record, lambda text: None)
        monkeypatch.setattr(real.run, "_operator", operator)
        trip = InterlockTripped("door", "the chain is open", 1.0)
        (typed_at_last := Timer(5.0, os.write, (keys, b"\n\n"))).start()
        for error in (trip, RecordError("the run folder was moved")):
            keyboard.read.clear()

            def at_the_prompt(error: Exception = error) -> None:
                keyboard.read.wait(LONG_S)
                assert "mount" in read_status(real.folder).message
                clock.interrupt(error)

            real.at_terminal(at_the_prompt)
            with AbortSignals(clock), pytest.raises(type(error)):
                real.run.ask(Prompt("mount", "Mount the gyro."))
            clock.interrupt(None)
        typed_at_last.cancel()
    assert [one["event"] for one in real.events].count("prompt-shown") == 2


def test_ctrl_c_at_a_pause_says_that_the_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pressed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(controlling, "ask", pressed)
    with pytest.raises(Aborted, match="withdrawn; the run goes on"):
        controlling.pause_run(tmp_path, as_json=False)


if sys.platform == "win32":
    pytest.skip("mode bits and signals of POSIX; not verified there", allow_module_level=True)


def test_a_second_wish_to_end_cuts_short_what_the_safe_state_waits_for(real: Desk) -> None:
    hurried: list[str] = []
    real.control.hurry = lambda: hurried.append("hurry")
    real.control.hold()
    assert ask(real.folder, "abort")["said"] == ENDS_ALREADY
    assert hurried == ["hurry"]
