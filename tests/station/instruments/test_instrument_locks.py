"""One run per instrument: whatever an address is spelled like, whoever the user is, whatever is
done to the files of the locks."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from command_line import PLAN, station
from guardian_helpers import World, world
from hypothesis import assume, given
from hypothesis import strategies as st

from station import registry
from station.cli.running import report_end
from station.clock import RealClock
from station.errors import InstrumentError, InstrumentInUse, InstrumentsMissing
from station.files.locks import is_held
from station.files.lookup import find
from station.instruments.addresses import GPIB, USB, forms_of
from station.instruments.bench import read_bench
from station.instruments.instrument_locks import (
    InstrumentLocks,
    lock_folder,
    lock_place,
    said_by_holder,
)
from station.instruments.opening import Probe, open_one, problems_of
from station.instruments.whole_bench import LeftOut
from station.runner.outcome import Outcome
from station.safety.safe_state import SafeOutcome

LOCKER = """
import os, sys
from station.instruments.instrument_locks import InstrumentLocks
if sys.argv[2:]:
    os.setgroups([])
    os.setgid(int(sys.argv[2]))
    os.setuid(int(sys.argv[2]))
locks = InstrumentLocks("the run runs/one")
try:
    locks.take("coil_supply.x", sys.argv[1])
    print("held", flush=True)
except Exception as error:
    print(error, flush=True)
sys.stdin.read()
"""
NOBODY = 65534


@contextmanager
def other_process(
    address: str, user: int | None = None, **environment: str
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Take an address in another process; yield what it says."""
    process = subprocess.Popen(
        [sys.executable, "-c", LOCKER, address, *([] if user is None else [str(user)])],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        env={**os.environ, **environment},
    )
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip(), process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def port() -> int:
    """A port that nobody else has at the moment."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


@pytest.fixture
def address(port: int) -> Iterator[str]:
    name = f"TCPIP::127.0.0.1::{port}::SOCKET"
    yield name
    for form in forms_of(name):
        with suppress(OSError):
            lock_place(form).unlink()


HOSTS = st.ip_addresses(v=4, network="198.51.100.0/24") | st.ip_addresses(
    v=6, network="2001:db8::/64"
)
OWN = st.ip_addresses(v=4, network="127.0.0.0/8") | st.just(IPv6Address("::1"))
PORTS = st.integers(1, 65535)
DEVICES = st.sampled_from(["inst0", "inst1", "hislip0", "gpib0,22", "gpib0,23", "gpib1,22"])
INSTRUMENTS = st.one_of(
    st.tuples(st.just("port"), HOSTS | OWN, PORTS),
    st.tuples(st.just("device"), HOSTS | OWN, DEVICES),
    st.tuples(st.just("can"), HOSTS | OWN, PORTS, st.sampled_from(["can0", "can1"])),
    st.tuples(st.just("gpib"), st.integers(0, 3), st.integers(0, 30)),
    st.tuples(st.just("usb"), PORTS, PORTS, st.sampled_from(["my5", "my6"]), st.integers(0, 2)),
    st.tuples(st.just("serial"), st.integers(1, 40)),
)
"""What the parts of an address distinguish."""


@st.composite
def spellings(draw: st.DrawFn, instrument: tuple[Any, ...]) -> str:
    """Draw an address of an instrument: one of those that reach it."""

    def spelled(host: IPv4Address | IPv6Address) -> list[str]:
        if host.is_loopback:
            return ["127.0.0.1", "localhost", "[::1]", "[0:0:0:0:0:0:0:1]", socket.gethostname()]
        if isinstance(host, IPv6Address):
            return [f"[{host.compressed}]", f"[{host.exploded}]"]
        return [str(host), f"[::ffff:{host}]"]

    def optional(number: int) -> str:
        return draw(st.sampled_from([str(number), ""] if number == 0 else [str(number)]))

    def any_base(number: int) -> str:
        return draw(
            st.sampled_from([f"0x{number:x}", f"0x{number:04x}", f"{number}", f"{number:05}"])
        )

    kind, *parts = instrument
    instr = draw(st.sampled_from(["", "::INSTR"]))
    match kind:
        case "port":
            host, port = draw(st.sampled_from(spelled(parts[0]))), parts[1]
            urls = [f"socket://{host}:{port}", f"rfc2217://{host}:{port}?logging=debug"]
            urls += [f"modbus-tcp://{host}:{port}", f"TCPIP0::{host}::{port}::SOCKET"]
            address = draw(st.sampled_from([*urls, f"TCPIP::{host}::{port}::SOCKET"]))
        case "device":
            host, device = draw(st.sampled_from(spelled(parts[0]))), parts[1]
            ways = [f"::{device}", *([""] if device == "inst0" else [])]
            ways += [f"::{device},4880"] if "," not in device else []
            address = f"TCPIP{optional(0)}::{host}{draw(st.sampled_from(ways))}::INSTR"
        case "can":
            host, port, channel = draw(st.sampled_from(spelled(parts[0]))), *parts[1:]
            address = f"socketcand://{host}:{port}/{channel}"
        case "gpib":
            address = f"GPIB{optional(parts[0])}::{parts[1]}{instr}"
        case "usb":
            maker, model, serial, interface = parts
            where = "" if interface == 0 and draw(st.booleans()) else f"::{interface}"
            address = f"USB{optional(0)}::{any_base(maker)}::{any_base(model)}::{serial}"
            address += f"{where}{instr}"
        case _:
            address = draw(st.sampled_from([f"COM{parts[0]}", f"ASRL{parts[0]}{instr}"]))
    case_of = draw(st.sampled_from([str, str.upper, str.lower]))
    return f"{draw(st.sampled_from(['', ' ']))}{case_of(address)}"


def locks_of(address: str) -> set[Path]:
    """Return the locks that a run takes for an address."""
    return {lock_place(form) for form in forms_of(address)}


@given(INSTRUMENTS, st.data())
def test_every_spelling_of_one_instrument_takes_the_same_locks(
    instrument: tuple[Any, ...], drawn: st.DataObject
) -> None:
    first, second = (drawn.draw(spellings(instrument)) for _ in range(2))
    assert locks_of(first) == locks_of(second), (first, second)


@given(INSTRUMENTS, INSTRUMENTS, st.data())
def test_two_instruments_share_no_lock(
    instrument: tuple[Any, ...], other: tuple[Any, ...], drawn: st.DataObject
) -> None:
    same = [
        tuple("here" if getattr(part, "is_loopback", False) else part for part in parts)
        for parts in (instrument, other)
    ]
    assume(same[0] != same[1])
    first, second = drawn.draw(spellings(instrument)), drawn.draw(spellings(other))
    assert not locks_of(first) & locks_of(second), (first, second)


def test_a_port_that_may_be_left_out_makes_no_difference() -> None:
    for scheme, port, path in (("modbus-tcp", 502, ""), ("socketcand", 29536, "/can0")):
        whole = forms_of(f"{scheme}://192.0.2.7:{port}{path}")
        assert forms_of(f"{scheme}://192.0.2.7{path}") == whole


@given(st.from_regex(USB, fullmatch=True) | st.from_regex(GPIB, fullmatch=True) | st.text())
def test_whatever_stands_in_the_place_of_an_address_stands_for_something(text: str) -> None:
    assume("://" not in text)  # a host's name would be looked up
    assert forms_of(text) == forms_of(f" {text} ")


def test_a_link_to_a_serial_port_is_that_port(tmp_path: Path) -> None:
    link = tmp_path / "by-id"
    link.symlink_to("/dev/null")
    assert forms_of(str(link)) == forms_of("/dev/null")


def test_the_name_of_a_host_that_nobody_knows_costs_no_more_than_its_time() -> None:
    assert forms_of("socket://no-such-host.invalid:5025") == {"tcp no-such-host.invalid 5025"}


@pytest.mark.parametrize(
    "environment", [{}, {"TMPDIR": "/var/tmp"}, {"XDG_RUNTIME_DIR": "/nowhere", "HOME": "/tmp"}]
)
def test_another_environment_or_spelling_finds_the_same_locks(
    address: str, port: int, environment: dict[str, str]
) -> None:
    locks = InstrumentLocks("the run runs/first")
    locks.take("coil_supply.x", address)
    with other_process(f"socket://localhost:{port}", **environment) as (said, _):
        assert "another process has it (the run runs/first)" in said
    locks.release()


def test_a_lock_whose_files_are_removed_is_still_held(address: str) -> None:
    locks = InstrumentLocks("the run runs/first")
    locks.take("coil_supply.x", address)
    for form in forms_of(address):
        lock_place(form).unlink()
    if sys.platform == "linux":
        with other_process(address) as (said, _):
            assert "another process has it" in said
    locks.release()
    with other_process(address) as (said, _):
        assert said == "held"


@pytest.mark.skipif(sys.platform == "win32", reason="links and pipes of Unix")
@pytest.mark.parametrize("plant", ["symlink", "hard link", "fifo"])
def test_what_is_planted_in_the_place_of_a_lock_is_neither_followed_nor_written(
    address: str, tmp_path: Path, plant: str
) -> None:
    victim = tmp_path / "victim"
    victim.write_text("what root has", encoding="utf-8")
    (form,) = forms_of(address)
    place = lock_place(form)
    try:
        match plant:
            case "symlink":
                place.symlink_to(victim)
            case "hard link":
                place.hardlink_to(victim)
            case _:
                os.mkfifo(place)
    except OSError as error:
        pytest.skip(f"another file system: {error}")
    with pytest.raises(InstrumentError, match="cannot be had"):
        InstrumentLocks("the run runs/first").take("coil_supply.x", address)
    assert victim.read_text(encoding="utf-8") == "what root has"
    place.unlink()


def test_locks_lie_where_every_user_may_put_some_and_none_may_remove_another_ones() -> None:
    about = lock_folder().stat()
    assert about.st_uid == 0
    assert about.st_mode & 0o1002 == 0o1002


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="needs two users")
def test_two_users_find_the_same_locks(address: str) -> None:
    locks = InstrumentLocks("the run of root")
    locks.take("coil_supply.x", address)
    with other_process(address, NOBODY) as (said, _):
        assert "the run of root" in said
    locks.release()
    with other_process(address, NOBODY) as (said, _):
        assert said == "held"
        with pytest.raises(InstrumentError, match="the run runs/one"):
            locks.take("coil_supply.x", address)


@pytest.mark.skipif(sys.platform == "win32", reason="no open files are handed on there")
def test_a_lock_is_free_when_every_process_that_holds_it_is_gone(address: str) -> None:
    first, second = InstrumentLocks("the run"), InstrumentLocks("its guardian")
    first.take("coil_supply.x", address)
    for names, files in first.to_hand_on():
        second.handed_on(names, [os.dup(file) for file in files])
    second.take("coil_supply.x", address)
    first.release()
    with other_process(address) as (said, _):
        assert "another process has it" in said
    second.say("the guardian, process 1")
    with other_process(address) as (said, _):
        assert "(the guardian, process 1)" in said
    second.release()
    with other_process(address) as (said, _):
        assert said == "held"


def files_of_locks() -> list[Path]:
    return sorted(lock_folder().glob("inertial-station-*.lock"))


@pytest.mark.skipif(sys.platform == "win32", reason="no open file is removed there")
def test_the_files_of_locks_go_with_the_last_who_holds_them(address: str) -> None:
    first, second = InstrumentLocks("the run"), InstrumentLocks("its guardian")
    first.take("coil_supply.x", address)
    places = [lock_place(form) for form in forms_of(address)]
    for names, files in first.to_hand_on():
        second.handed_on(names, [os.dup(file) for file in files])
    first.release()
    assert all(place.is_file() for place in places)
    second.release()
    assert not any(place.exists() for place in places)


@pytest.mark.skipif(sys.platform == "win32", reason="no open file is removed there")
def test_what_a_killed_process_left_goes_with_the_next_release(address: str, port: int) -> None:
    with other_process(address) as (said, process):
        assert said == "held"
        process.kill()
        process.wait()
    left = [lock_place(form) for form in forms_of(address)]
    assert all(place.is_file() for place in left)
    held, released = (f"TCPIP::192.0.2.{host}::{port}::SOCKET" for host in (9, 8))
    with other_process(held):
        locks = InstrumentLocks("the next run")
        locks.take("coil_supply.y", released)
        locks.release()
        for gone in (*left, *map(lock_place, forms_of(released))):
            assert not gone.exists()
        assert all(lock_place(form).is_file() for form in forms_of(held))


@pytest.mark.skipif(sys.platform == "win32", reason="no open file is removed there")
def test_however_many_take_and_release_a_lock_at_once_one_has_it(
    address: str, tmp_path: Path
) -> None:
    taken, wrong = [], []
    until_s = time.monotonic() + 1.0

    def work(number: int) -> None:
        while time.monotonic() < until_s:
            locks = InstrumentLocks(f"run {number}")
            try:
                locks.take("coil_supply.x", address)
            except InstrumentInUse:
                continue
            try:
                (tmp_path / "inside").touch(exist_ok=False)
                (tmp_path / "inside").unlink()
                taken.append(number)
            except FileExistsError:
                wrong.append(number)
            locks.release()

    threads = [Thread(target=work, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    assert len(set(taken)) > 1
    assert not any(lock_place(form).exists() for form in forms_of(address))


@pytest.mark.campaign
def test_a_run_of_a_served_bench_and_its_guardian_leave_no_file_of_a_lock(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    with world(tmp_path, 40.0) as served:
        options = ("--served", str(served.head), "--non-interactive", "--json")
        done = station(tmp_path, "run", "plan.yaml", *options)
    assert done.returncode == 0, done.stderr
    # Others' files are of tests beside this one, which kill what holds them.
    left = [place for place in files_of_locks() if str(tmp_path) in said_by_holder(place)]
    assert [place for place in left if not is_held(place)] == []


@dataclass
class Relay:
    """A serial server in small: the same instrument at a second address."""

    port: int
    listening: socket.socket


@pytest.fixture
def relay(bench: World) -> Iterator[Relay]:
    head = json.loads(bench.head.read_text(encoding="utf-8").splitlines()[0])
    supply = int(head["instruments"]["coil_supply.x"]["port"])
    listening = socket.create_server(("127.0.0.1", 0))

    def pump(source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(4096):
                sink.sendall(data)
        with suppress(OSError):
            sink.shutdown(socket.SHUT_RDWR)

    def serve() -> None:
        with suppress(OSError):
            while True:
                client, _ = listening.accept()
                line = socket.create_connection(("127.0.0.1", supply))
                for pair in ((client, line), (line, client)):
                    Thread(target=pump, args=pair, daemon=True).start()

    Thread(target=serve, daemon=True).start()
    yield Relay(int(listening.getsockname()[1]), listening)
    listening.shutdown(socket.SHUT_RDWR)
    listening.close()


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with world(tmp_path_factory.mktemp("world")) as served:
        yield served


def opened(address: str, locks: InstrumentLocks) -> Probe:
    shipped = read_bench(find("benches", "sim"), registry.names(registry.DRIVERS))
    name = "coil_supply.x"
    probe = open_one(name, shipped, {name: address}, RealClock(), locks=locks)
    if probe.identified is not None:
        probe.identified.instrument.close()
    return probe


def test_an_instrument_is_known_again_by_what_it_reports_of_itself(
    bench: World, relay: Relay
) -> None:
    head = json.loads(bench.head.read_text(encoding="utf-8").splitlines()[0])
    direct = head["instruments"]["coil_supply.x"]["address"]
    about = str(head["clock"]["epoch_unix"])
    first, second = InstrumentLocks("the run runs/first", about), InstrumentLocks("another", about)
    assert opened(direct, first).ok
    refused = opened(f"TCPIP::127.0.0.1::{relay.port}::SOCKET", second)
    assert not refused.ok
    assert "another process has it (the run runs/first)" in refused.said
    second.release()
    elsewhere = InstrumentLocks("a simulated bench of its own", "served at another time")
    assert opened(f"TCPIP::127.0.0.1::{relay.port}::SOCKET", elsewhere).said.startswith("KEPCO")
    first.release()
    elsewhere.release()
    assert opened(f"TCPIP::127.0.0.1::{relay.port}::SOCKET", second).ok
    second.release()


def test_a_refused_second_run_names_who_has_its_instruments_once(
    capsys: pytest.CaptureFixture[str],
) -> None:
    who = "the run /bench/runs/first (process 4711)"
    used = ("coil_supply.x", "coil_supply.y", "gaussmeter")
    refused = [InstrumentInUse(name, "take it", who) for name in used]
    probes = [Probe(one.instrument, False, str(one), in_use_by=one.who) for one in refused]
    silent = Probe("imu", False, "imu: read it: nothing came; look at its cable")
    error = str(InstrumentsMissing(problems_of([*probes, silent]), 4))
    assert error.startswith("4 instruments are missing")
    assert "- coil_supply.x, coil_supply.y, gaussmeter: another process has them (the run" in error
    assert silent.said in error
    left_out = [LeftOut(name, f"in use by {who}", "") for name in used[:2]]
    outside = [SafeOutcome("turntable", True, "at rest", 0.1, used=False)]
    report_end(Outcome(Path("second"), error=error, outside=outside, left_out=left_out))
    said = capsys.readouterr().err
    assert said.count(who) == 1
    assert "NOT KNOWN to be safe: coil_supply.x, coil_supply.y (in use by that process)" in said
    assert "the bench is safe" not in said
