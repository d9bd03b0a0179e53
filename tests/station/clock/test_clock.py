"""The virtual clock keeps one order, loses no time, and names who hangs."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import ExitStack

import pytest

from sim_instruments.wire.requests import LineServer
from sim_instruments.wire.tcp import HOST
from station.clock import Clock, ClockError, ClockStopped, RealClock, VirtualClock


def test_time_jumps_to_the_earliest_sleeper_in_a_fixed_order() -> None:
    orders = set()
    for _ in range(50):
        clock = VirtualClock()
        seen: list[tuple[str, float]] = []

        def sleeper(name: str, clock: VirtualClock = clock, seen: list = seen) -> None:
            for _ in range(5):
                clock.sleep(0.5)
                seen.append((name, clock.now()))

        with clock.participant("run"):
            threads = [clock.start(name, lambda n=name: sleeper(n)) for name in "dbca"]
            clock.sleep(10.0)
        for thread in threads:
            thread.join(5.0)
        clock.stop()
        orders.add(tuple(seen))
    assert len(orders) == 1
    assert [name for name, _ in seen[:4]] == ["a", "b", "c", "d"]
    assert clock.now() == 10.0


def test_a_thread_outside_time_may_not_sleep() -> None:
    clock = VirtualClock()
    with pytest.raises(ClockError, match=r"takes no part in time"):
        clock.sleep(1.0)


def test_who_goes_on_after_time_has_failed_is_not_given_a_second_turn() -> None:
    clock = VirtualClock()

    def body() -> None:
        clock._turns.fail("the wire has failed")
        time.sleep(0.2)  # while whoever waits takes note of it

    with clock.participant("run"):
        thread = clock.start("device", body)
        with pytest.raises(ClockError, match="the wire has failed"):
            clock.sleep(1.0)
        thread.join(5.0)
        with pytest.raises(ClockError, match="the wire has failed"):
            clock.sleep(1.0)
    clock.stop()


def test_stop_ends_started_threads_quietly() -> None:
    clock = VirtualClock()
    ended: list[str] = []

    def body() -> None:
        try:
            while True:
                clock.sleep(1.0)
        except ClockStopped:
            ended.append("stopped")
            raise

    with clock.participant("run"):
        thread = clock.start("device", body)
        clock.sleep(3.5)
        clock.stop()
        thread.join(5.0)
    assert ended == ["stopped"]
    assert not thread.alive


def echo_server(clock: VirtualClock, latency_s: float) -> tuple[int, threading.Thread]:
    """Serve one client on loopback: answers each line after `latency_s`; `silent` gets nothing."""
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    wire = clock.wire(f"127.0.0.1:{port}")

    def serve() -> None:
        connection, _ = listener.accept()
        with connection, listener:
            while data := connection.recv(4096):
                with wire.serving(len(data)):
                    if data != b"silent\n":
                        clock.sleep(latency_s)
                        connection.sendall(data)
                        wire.answered(len(data))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    return port, thread


def ask(client: socket.socket, wire, clock, text: bytes, deadline_s: float) -> bytes | None:
    wire.sent(len(text))
    client.sendall(text)
    if not wire.wait(clock.now() + deadline_s):
        return None
    data = client.recv(4096)
    wire.received()
    return data


def test_an_exchange_takes_the_servers_latency_and_no_more() -> None:
    clock = VirtualClock()
    port, thread = echo_server(clock, latency_s=0.02)
    wire = clock.wire(f"127.0.0.1:{port}")
    with socket.create_connection(("127.0.0.1", port)) as client, clock.participant("run"):
        wire.open()
        ticks = []

        def ticker() -> None:
            while True:
                clock.sleep(0.013)
                ticks.append(clock.now())

        clock.start("ticker", ticker)
        for _ in range(100):
            assert ask(client, wire, clock, b"hello\n", 0.5) == b"hello\n"
        assert clock.now() == pytest.approx(2.0)
        assert len(ticks) == int(2.0 / 0.013)
        wire.close()
        clock.stop()
    thread.join(5.0)


def test_a_silent_instrument_costs_its_deadline_on_the_runs_clock() -> None:
    clock = VirtualClock()
    port, thread = echo_server(clock, latency_s=0.0)
    wire = clock.wire(f"127.0.0.1:{port}")
    with socket.create_connection(("127.0.0.1", port)) as client, clock.participant("run"):
        wire.open()
        assert ask(client, wire, clock, b"silent\n", 0.5) is None
        assert clock.now() == 0.5
        assert ask(client, wire, clock, b"again\n", 0.5) == b"again\n"
        wire.close()
    clock.stop()
    thread.join(5.0)


def test_a_write_without_answer_is_served_before_time_moves() -> None:
    clock = VirtualClock()
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    wire = clock.wire(f"127.0.0.1:{port}")
    times: list[float] = []

    def serve() -> None:
        connection, _ = listener.accept()
        with connection, listener:
            while data := connection.recv(1):
                with wire.serving(len(data)):
                    times.append(clock.now())

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    with socket.create_connection(("127.0.0.1", port)) as client, clock.participant("run"):
        wire.open()
        for _ in range(20):
            wire.sent(1)
            client.sendall(b"x")
            clock.sleep(1.0)
        wire.close()
    clock.stop()
    thread.join(5.0)
    assert times == [float(second) for second in range(20)]


def test_two_requests_on_one_wire_are_served_one_after_the_other() -> None:
    for _ in range(20):
        clock = VirtualClock()
        port, thread = echo_server(clock, latency_s=0.01)
        wire = clock.wire(f"127.0.0.1:{port}")
        with socket.create_connection(("127.0.0.1", port)) as client, clock.participant("run"):
            wire.open()
            for text in (b"first\n", b"second\n"):
                wire.sent(len(text))
                client.sendall(text)
            clock.sleep(1.0)
            assert client.recv(4096).startswith(b"first\n")
            wire.received()
            assert ask(client, wire, clock, b"third\n", 0.5) is not None
            wire.close()
        clock.stop()
        thread.join(5.0)


def test_a_lock_is_waited_for_without_holding_time() -> None:
    clock = VirtualClock()
    lock = clock.lock("supply")
    seen: list[tuple[str, float]] = []

    def second() -> None:
        clock.sleep(1.0)
        with lock:
            seen.append(("second", clock.now()))

    with clock.participant("run"):
        thread = clock.start("second", second)
        with lock:
            clock.sleep(5.0)
            seen.append(("first", clock.now()))
        clock.sleep(1.0)
    thread.join(5.0)
    clock.stop()
    assert seen == [("first", 5.0), ("second", 5.0)]


def test_an_interruption_ends_the_main_sleep() -> None:
    for clock in (VirtualClock(), RealClock()):
        clock.interrupt(KeyboardInterrupt())
        with clock.participant("run"), pytest.raises(KeyboardInterrupt):
            clock.sleep(3600.0)
        clock.stop()


def test_an_interruption_by_another_thread_wakes_the_main_one_at_its_time() -> None:
    clock = VirtualClock()

    def trip() -> None:
        clock.sleep(2.0)
        clock.interrupt(KeyboardInterrupt())
        clock.sleep(1.0)

    with clock.participant("run"):
        clock.start("interlocks", trip)
        with pytest.raises(KeyboardInterrupt):
            clock.sleep(3600.0)
        assert clock.now() == 2.0
    clock.stop()


def test_a_faster_clock_runs_faster_than_the_real_one() -> None:
    real, fast = RealClock(), RealClock(speed=50.0)
    real.sleep(0.1)
    assert fast.now() > 10 * real.now()


def test_who_answers_at_once_does_so_in_the_thread_that_asks() -> None:
    clock, threads = VirtualClock(), []

    def answer(line: bytes) -> bytes:
        threads.append(threading.get_ident())
        return line + b"\n"

    server = LineServer("device", 0, clock, clock.lock("world"), answer, at_once=True)
    server.begin()
    wire = clock.wire(server.address)
    with clock.participant("run"), socket.create_connection((HOST, server.port)) as client:
        wire.open()
        for _ in range(3):
            assert ask(client, wire, clock, b"?\n", 0.5) == b"?\n"
        assert clock.now() == 0.0
        wire.close()
    server.close()
    clock.stop()
    # The first request finds out that it comes from this process.
    assert threads[0] != threading.get_ident()
    assert threads[1:] == [threading.get_ident()] * 2


def test_who_has_just_connected_hears_a_device_that_talks() -> None:
    clock = VirtualClock()
    server = LineServer("device", 0, clock, clock.lock("world"), lambda line: b"")
    with socket.create_connection((HOST, server.port)):  # nobody accepts in a thread of its own
        assert len(server.connected()) == 1
    server.close()
    assert server.connected() == []
    clock.stop()


def test_a_message_to_one_that_answers_at_once_does_not_hold_up_another() -> None:
    clock, said = VirtualClock(), []

    def answer(line: bytes) -> bytes:
        said.append((line, clock.now()))
        return line + b"\n" if line.endswith(b"?") else b""

    servers = [
        LineServer(name, 0, clock, clock.lock("world"), answer, at_once=True) for name in "ab"
    ]
    with clock.participant("run"), ExitStack() as lines:
        wires, clients = [], []
        for server in servers:
            server.begin()
            wires.append(clock.wire(server.address))
            clients.append(lines.enter_context(socket.create_connection((HOST, server.port))))
            wires[-1].open()
            assert ask(clients[-1], wires[-1], clock, b"?\n", 0.5) == b"?\n"
        clock.start("other", lambda: clock.sleep(1.0))
        wires[0].sent(4)
        clients[0].sendall(b"off\n")
        assert ask(clients[1], wires[1], clock, b"on?\n", 0.5) == b"on?\n"
        for wire in wires:
            wire.close()
    for server in servers:
        server.close()
    clock.stop()
    assert said[2:] == [(b"off", 0.0), (b"on?", 0.0)]


def test_who_answers_at_once_may_not_wait() -> None:
    clock = VirtualClock()

    def answer(line: bytes) -> bytes:
        clock.sleep(len(told))
        return line + b"\n"

    told: list[str] = []
    server = LineServer("device", 0, clock, clock.lock("world"), answer, at_once=True)
    server.begin()
    wire = clock.wire(server.address)
    with clock.participant("run"), socket.create_connection((HOST, server.port)) as client:
        wire.open()
        assert ask(client, wire, clock, b"?\n", 0.5) == b"?\n"
        told.append("one second")
        with pytest.raises(ClockError, match=r"answers at once, it cannot be sleeping"):
            ask(client, wire, clock, b"?\n", 0.5)
        wire.close()
    server.close()
    clock.stop()


@pytest.mark.parametrize("clock", [VirtualClock(), RealClock(speed=50.0)], ids=["virtual", "real"])
def test_what_repeats_comes_at_its_times_until_it_ends(clock: Clock) -> None:
    seen: list[float] = []

    def step() -> float | None:
        seen.append(clock.now())
        return seen[0] + len(seen) if len(seen) < 4 else None

    began_s = clock.now()
    with clock.participant("run"):
        clock.repeat("device", began_s + 0.5, step)
        clock.sleep_until(began_s + 8.0)
    clock.stop()
    due = [began_s + 0.5, *(seen[0] + one for one in (1, 2, 3))]
    assert len(seen) == 4
    assert all(one >= at for one, at in zip(seen, due, strict=True))
    if isinstance(clock, VirtualClock):
        assert seen == due


def test_a_step_that_fails_is_told_and_does_not_let_time_run_on() -> None:
    clock = VirtualClock()

    def step() -> float | None:
        raise ValueError("no such register")

    with clock.participant("run"):
        clock.repeat("device", 1.0, step)
        with pytest.raises(ClockError, match=r"device has failed: .*no such register"):
            clock.sleep(5.0)
    clock.stop()


def test_a_simulator_that_fails_is_named_with_its_file_and_line() -> None:
    clock, left = VirtualClock(), [2, 1, 0]
    server = LineServer(
        "multimeter",
        0,
        clock,
        clock.lock("world"),
        lambda _: b"%d\n" % (2 // left.pop(0)),
        at_once=True,
    )
    server.begin()
    wire = clock.wire(server.address)
    with clock.participant("run"), socket.create_connection((HOST, server.port)) as client:
        wire.open()
        assert [ask(client, wire, clock, b"?\n", 0.5) for _ in left[:2]] == [b"1\n", b"2\n"]
        wrong = r"the simulator of multimeter has failed: .*by zero, in test_clock\.py:\d+"
        with pytest.raises(ClockError, match=wrong):
            ask(client, wire, clock, b"?\n", 0.5)
        wire.close()
    server.close()
    clock.stop()
