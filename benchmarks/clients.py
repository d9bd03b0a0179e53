"""Whether other programs find the simulated instruments as they find real ones.

Client libraries of others, written from the makers' manuals and tried on real instruments, are let
loose on each simulator that they know: every value they can read is read, and what they can set is
set to what was read (or, where it cannot be read, to the first value they allow). An attempt counts
where the client raises nothing and the instrument's error queue stays empty. First and second
models are counted apart; `refused` names what does not work, most of it options that the model does
not have. Families without a client that pip installs have a line without counts.

    pip install -c constraints.txt -e ".[test,clients]"
    python benchmarks/clients.py                  # all of them
    python benchmarks/clients.py keithley-dmm6500 --say

What one client cannot be given (a curve, a file, a channel of its choice) is left out of its count.
"""

from __future__ import annotations

import argparse
import inspect
import json
import logging
import re
import socket
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from figures import Figures
from our_drivers import CASES, as_text, bench_data, driver_of, name_of, shipped, world_of

from station import registry

Attempt = tuple[str, Callable[[], object]]
"""What is tried, and how."""
Walk = Callable[[Mapping[str, Any]], Iterator[Attempt]]
"""Opens a client at a served address and yields what it can do."""

NOT_OF_THE_INSTRUMENT = {
    "timeout",
    "adapter",
    "name",
    "address",
    "terminator",
    "prompt",
    "baud_rate",
}
GIVEN: Mapping[str, object] = {
    "output": 1,
    "heater_output": 1,
    "input_channel": "A",
    "channel": "A",
    "curve": 1,
    "curve_number": 1,
    "index": 1,
    "zone": 1,
    "relay_channel": 1,
    "relay_number": 1,
    "field": 1,
    "length_of_time_in_seconds": 0.3,
    "sample_rate_in_ms": 100,
}
"""Arguments of a client's questions."""
SETTLES_S = 0.02
"""How long a command that is not answered takes to be carried out, before errors are asked for."""
QUEUE = 30
"""More errors than an instrument keeps."""


def properties(thing: Any, prefix: str = "") -> Iterator[Attempt]:
    """Yield the properties of a client's class: what it reads, then what it sets."""
    for name, member in inspect.getmembers(type(thing), lambda at: isinstance(at, property)):
        if name.startswith("_") or name in NOT_OF_THE_INSTRUMENT:
            continue
        read: list[object] = []

        def reads(name: str = name, read: list[object] = read) -> None:
            read.append(getattr(thing, name))

        def sets(name: str = name, read: list[object] = read, member: Any = member) -> None:
            setattr(thing, name, read[0] if read else first_allowed(member.fset))

        if member.fget is not None:
            yield f"{prefix}{name}?", reads
        if member.fset is not None:
            yield f"{prefix}{name}=", sets


def first_allowed(fset: Any) -> object:
    """Return the first value of those that the setter of a property allows."""
    allowed = inspect.signature(fset).parameters.get("values")
    if allowed is None or not allowed.default:
        raise NotGiven
    return next(iter(allowed.default))


class NotGiven(LookupError):
    """A client asks for what only its user can give it, or has no such direction."""


def pymeasure(path: str, *parts: str, without: str = "$^", **keywords: object) -> Walk:
    """Walk an instrument of PyMeasure, with its channels; `parts` are further attributes of it.

    What `without` matches needs an option that the instrument does not have, and is left out.
    """

    def walk(served: Mapping[str, Any]) -> Iterator[Attempt]:
        client = named(f"pymeasure.instruments.{path}")(
            f"TCPIP::{served['host']}::{served['port']}::SOCKET",
            **keywords,
        )
        client.adapter.connection.timeout = 1500
        for name, attempt in of_pymeasure(client, parts):
            if not re.match(without, name):
                yield name, attempt
                leave_nothing_on(client.adapter.connection)

    return walk


def leave_nothing_on(resource: Any) -> None:
    """Read what a client asked for and left, so that its next answer is the next question's."""
    import pyvisa

    usual, resource.timeout = resource.timeout, 20
    with suppress(pyvisa.VisaIOError):
        while True:
            resource.read_raw()
    resource.timeout = usual


def of_pymeasure(client: Any, parts: Iterable[str]) -> Iterator[Attempt]:
    """Yield the properties of an instrument of PyMeasure, of its channels and further parts."""
    yield from properties(client)
    channels = {key: value for group in groups_of(client) for key, value in group.items()}
    for key, channel in channels.items():
        yield from properties(channel, f"{key}.")
    for part in parts:
        yield from properties(getattr(client, part), f"{part}.")


def groups_of(client: Any) -> list[Mapping[Any, Any]]:
    """Return the groups of channels of an instrument of PyMeasure."""
    pairs = getattr(client, "_ChannelPairs", None) or inspect.getmembers(
        type(client), lambda at: type(at).__name__ in {"ChannelCreator", "MultiChannelCreator"}
    )
    names = {creator.kwargs.get("collection", "channels") for _, creator in pairs} or {"channels"}
    found = [getattr(client, name, None) for name in names | {"channels"}]
    groups = [group for group in found if isinstance(group, Mapping)]
    return groups or [{name: getattr(client, name)} for name, _ in pairs if hasattr(client, name)]


def qcodes(path: str, **keywords: object) -> Walk:
    """Walk the parameters of a QCoDeS instrument and of all its modules."""

    def walk(served: Mapping[str, Any]) -> Iterator[Attempt]:
        at = f"TCPIP::{served['host']}::{served['port']}::SOCKET"
        client = named(path)("client", at, timeout=1.5, **keywords)
        try:
            for attempt in parameters(client):
                yield attempt
                leave_nothing_on(client.visa_handle)
        finally:
            client.close()

    return walk


def parameters(module: Any, prefix: str = "") -> Iterator[Attempt]:
    """Yield the parameters of a QCoDeS module: what it reads, then what it sets."""
    for name, parameter in module.parameters.items():
        if name in NOT_OF_THE_INSTRUMENT:
            continue
        if parameter.gettable:
            yield f"{prefix}{name}?", parameter.get
        if parameter.gettable and parameter.settable:
            yield f"{prefix}{name}=", partial(set_again, parameter)
    for name, part in module.submodules.items():
        for each in getattr(part, "_channels", [part]):
            if hasattr(each, "parameters"):
                yield from parameters(each, f"{prefix}{getattr(each, 'short_name', name)}.")


def set_again(parameter: Any) -> None:
    """Set a QCoDeS parameter to what it reads."""
    parameter.set(parameter.get())


def lakeshore(name: str) -> Walk:
    """Walk an instrument of Lake Shore's own package: its questions, and what answers them sets."""

    def walk(served: Mapping[str, Any]) -> Iterator[Attempt]:
        client = named(f"lakeshore.{name}")(ip_address=served["host"], tcp_port=served["port"])
        for method, _ in inspect.getmembers(type(client), inspect.isfunction):
            if not method.startswith("get_"):
                continue
            asked = getattr(client, method)
            wanted = inspect.signature(asked).parameters
            missing = [key for key, at in wanted.items() if at.default is at.empty]
            given = {key: GIVEN[key] for key in missing if key in GIVEN}
            if len(given) < len(missing):
                continue
            read: list[object] = []
            yield f"{method}()", partial(keep_answer, asked, given, read)
            setter = getattr(client, method.replace("get_", "set_", 1), None)
            if setter is not None:
                yield f"set_{method[4:]}()", partial(set_back, setter, given, read)
        client.disconnect_tcp()

    return walk


def keep_answer(asked: Any, given: Mapping[str, object], read: list[object]) -> None:
    """Ask a question, and keep its answer."""
    read.append(asked(**given))


def set_back(setter: Any, given: Mapping[str, object], read: list[object]) -> None:
    """Call a setter with what its question returned."""
    keys = list(inspect.signature(setter).parameters)
    known = {key: GIVEN[key] for key in keys if key in given}
    rest = [key for key in keys if key not in known]
    if not read:
        raise NotGiven
    answer = read[0]
    if len(rest) == 1:
        values: Mapping[str, object] = {rest[0]: answer}
    elif isinstance(answer, Mapping) and set(rest) <= set(answer):
        values = {key: answer[key] for key in rest}
    else:
        raise NotGiven
    setter(**known, **values)


def instrumentkit(path: str, *parts: str, without: str = "$^") -> Walk:
    """Walk an instrument of InstrumentKit; `parts` are attributes of it, `axis[0]` an element.

    What `without` matches is left out: what no such instrument has, and the client is out of step
    behind its refusal.
    """

    def walk(served: Mapping[str, Any]) -> Iterator[Attempt]:
        client = named(f"instruments.{path}").open_tcpip(served["host"], served["port"])
        with suppress(Exception):
            client._file._conn.settimeout(1.5)
        for name, attempt in properties(client):
            if not re.match(without, name):
                yield name, attempt
        for part in parts:
            name, _, index = part.rstrip("]").partition("[")
            inner = getattr(client, name)
            yield from properties(inner[int(index)] if index else inner, f"{part}.")

    return walk


def registers(values: Mapping[str, tuple[int, str]], *, settable: Iterable[str] = ()) -> Walk:
    """Walk registers that programs of others read with pymodbus; each a float or an integer."""

    def walk(served: Mapping[str, Any]) -> Iterator[Attempt]:
        from pymodbus import FramerType
        from pymodbus.client import ModbusTcpClient

        framer = FramerType.SOCKET if served["protocol"] == "modbus-tcp" else FramerType.RTU
        client: Any = ModbusTcpClient(
            served["host"], port=served["port"], timeout=1.5, framer=framer
        )
        client.connect()

        def read(address: int, kind: str) -> Any:
            count = 2 if kind == "float" else 1
            answer = client.read_holding_registers(address, count=count, device_id=1)
            if answer.isError():
                raise ValueError(str(answer))
            type_ = client.DATATYPE.FLOAT32 if count == 2 else client.DATATYPE.INT16
            return client.convert_from_registers(answer.registers, type_, word_order="little")

        def write_back(address: int, kind: str) -> None:
            type_ = client.DATATYPE.FLOAT32 if kind == "float" else client.DATATYPE.INT16
            words = client.convert_to_registers(read(address, kind), type_, word_order="little")
            answer = client.write_registers(address, words, device_id=1)
            if answer.isError():
                raise ValueError(str(answer))

        for name, (address, kind) in values.items():
            yield f"{name}?", partial(read, address, kind)
            if name in settable:
                yield f"{name}=", partial(write_back, address, kind)
        client.close()

    return walk


def messages(served: Mapping[str, Any]) -> Iterator[Attempt]:
    """Walk a device on CAN with python-can and cantools: its commands, then all it sends."""
    import can
    import cantools

    database = cantools.database.load_file(served["dbc"])
    command = next(at for at in database.messages if at.name.endswith("_COMMAND"))
    answer = next(at for at in database.messages if at.name.endswith("_ACK"))
    choices = {
        str(at): int(number) for number, at in command.get_signal_by_name("command").choices.items()
    }
    heard: dict[int, bytes] = {}
    bus = can.Bus(
        interface="socketcand", host=served["host"], port=served["port"], channel=served["channel"]
    )

    def say(number: int) -> None:
        values = {at.name: min(max(at.minimum or 0, 10), at.maximum) for at in command.signals}
        data = command.encode({**values, "command": number}, strict=False)
        bus.send(can.Message(arbitration_id=command.frame_id, data=data, is_extended_id=False))
        until = time.monotonic() + 1.5
        while time.monotonic() < until:
            if (frame := bus.recv(0.1)) is not None:
                heard[frame.arbitration_id] = bytes(frame.data)
        result = decoded(answer)["result"]
        if int(getattr(result, "value", result)):
            raise ValueError(f"the command is answered by {result}")

    def decoded(message: Any) -> Any:
        if message.frame_id not in heard:
            raise ValueError("no such frame came")
        return message.decode(heard[message.frame_id])

    for name in sorted(choices, key=lambda at: at == "stop"):
        yield f"{command.name} {name}", partial(say, choices[name])
    for message in database.messages:
        if message is not command:
            yield message.name, partial(decoded, message)
    bus.shutdown()


def named(path: str) -> Any:
    """Return what an import path names."""
    module, _, name = path.rpartition(".")
    return getattr(__import__(module, fromlist=[name]), name)


F4T = {
    "set point": (2782, "float"),
    "active set point": (2810, "float"),
    "process value": (2820, "float"),
    "lowest set point": (2774, "float"),
    "highest set point": (2776, "float"),
    "manual power": (2784, "float"),
    "power": (2808, "float"),
    "mode asked": (2730, "integer"),
    "mode": (2814, "integer"),
    **{
        f"clock {name}": (14664 + 2 * place, "integer")
        for place, name in enumerate(("hour", "minute", "second", "month", "day", "year"))
    },
    "profile to start": (16558, "integer"),
    "profile action": (16562, "integer"),
    "profile action 2": (16566, "integer"),
    "profile state": (16568, "integer"),
    **{f"alarm {number}": (1356 + 100 * (number - 1), "integer") for number in range(1, 5)},
}
F4 = {
    "process value": (100, "integer"),
    "set point": (300, "integer"),
    "power of heat": (103, "integer"),
    "power of cool": (107, "integer"),
    "operation": (200, "integer"),
    "input 1": (201, "integer"),
    "input 2": (213, "integer"),
    "input active at": (1061, "integer"),
    "events": (2000, "integer"),
    **{
        f"clock {name}": (1916 + place, "integer")
        for place, name in enumerate(("hour", "minute", "second", "month", "day", "year"))
    },
}

LF = {"read_termination": "\n", "write_termination": "\n"}
CLIENTS: Mapping[str, Mapping[str, Walk]] = {
    "kepco-bop-36-12": {"pymeasure KepcoBOP3612": pymeasure("kepco.KepcoBOP3612")},
    "kepco-bop-1kw": {"pymeasure KepcoBOP3612": pymeasure("kepco.KepcoBOP3612")},
    "lakeshore-f71": {"lakeshore Teslameter": lakeshore("Teslameter")},
    "lakeshore-425": {"pymeasure LakeShore425": pymeasure("lakeshore.LakeShore425", **LF)},
    "lakeshore-336": {
        "lakeshore Model336": lakeshore("Model336"),
        "qcodes LakeshoreModel336": qcodes(
            "qcodes.instrument_drivers.Lakeshore.LakeshoreModel336", terminator="\r\n"
        ),
    },
    "keysight-34465a": {
        "qcodes Keysight34465A": qcodes("qcodes.instrument_drivers.Keysight.Keysight34465A"),
        "pymeasure HP34401A": pymeasure("hp.HP34401A", **LF),
        "pymeasure Agilent34410A": pymeasure("agilent.Agilent34410A", **LF),
        "instrumentkit Agilent34410a": instrumentkit("agilent.Agilent34410a"),
    },
    "keithley-dmm6500": {
        "pymeasure KeithleyDMM6500": pymeasure(
            "keithley.KeithleyDMM6500",
            without=r"\d+\.|scan_|pseudo_scanner",  # of a scanner card
            write_termination="\n",
        ),
        "qcodes Keithley6500": qcodes("qcodes.instrument_drivers.Keithley.Keithley6500"),
    },
    "keysight-33522b": {
        "pymeasure Agilent33500": pymeasure("agilent.Agilent33500", **LF),
        "qcodes Keysight33522B": qcodes("qcodes.instrument_drivers.Keysight.Keysight33522B"),
    },
    "rigol-dg800": {"pymeasure DG800": pymeasure("rigol.DG800", **LF)},
    "keysight-e36312a": {
        "pymeasure KeysightE36312A": pymeasure("keysight.KeysightE36312A", **LF),
        "qcodes-contrib KeysightE36313A": qcodes(
            "qcodes_contrib_drivers.drivers.Keysight.Keysight_E36313A.E36313A"
        ),
    },
    "newport-esp301": {
        "pymeasure ESP300": pymeasure(
            "newport.ESP300",
            "x",
            without="(complete|id|next_error|options|status)\\?",  # it speaks no IEEE 488.2
            read_termination="\r\n",
            write_termination="\r",
        ),
        "instrumentkit NewportESP301": instrumentkit("newport.NewportESP301", "axis[0]"),
    },
    "red-pitaya-125-14": {
        "pymeasure RedPitayaScpi": pymeasure(
            "redpitaya.RedPitayaScpi", read_termination="\r\n", write_termination="\r\n"
        )
    },
    "thorlabs-sc10": {"instrumentkit SC10": instrumentkit("thorlabs.SC10", without="enable=")},
    "watlow-f4t": {
        "pymodbus, registers of ChamberConnectLibrary": registers(
            F4T, settable=("set point", "mode asked", "manual power")
        )
    },
    "watlow-f4": {
        "pymodbus, registers of ChamberConnectLibrary": registers(F4, settable=("set point",))
    },
    "can-pulse-board": {"python-can, cantools": messages},
    "can-navigator": {"python-can, cantools": messages},
    "can-imu": {"python-can, cantools": messages},
}
WRITTEN_FOR: Mapping[str, Mapping[str, object]] = {"instrumentkit SC10": {"prompt": "bare"}}
"""The form of an instrument that a client was written for, where there are several."""


@contextmanager
def served(case_name: str, folder: Path, client: str = "") -> Iterator[Mapping[str, Any]]:
    """Serve the instrument of a driver alone, in real time; yield how it is reached."""
    bench = folder / f"{case_name}.yaml"
    data = bench_data(case_name)
    data["instruments"][name_of(case_name)]["simulator"].update(WRITTEN_FOR.get(client, {}))
    bench.write_text(as_text(data), encoding="utf-8")
    arguments = [str(bench), "--procedure", world_of(case_name), "--until-stdin-closes"]
    with subprocess.Popen(
        [sys.executable, "-m", "station", "sim", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdout is not None and process.stdin is not None
        head = json.loads(process.stdout.readline())
        try:
            yield head["instruments"][name_of(case_name)]
        finally:
            process.stdin.close()
            process.wait()


class ErrorQueue:
    """The instrument's own errors, asked over a line of their own where it keeps a queue."""

    def __init__(self, served: Mapping[str, Any], driver: Any) -> None:
        self._question = getattr(driver, "error_query", "") if served["protocol"] == "scpi" else ""
        self._none = getattr(driver, "no_error", "")
        self._line = (
            socket.create_connection((served["host"], served["port"]), 3)
            if self._question
            else None
        )

    def errors(self) -> str:
        """Return what stands in the queue, which is empty then."""
        told: list[str] = []
        time.sleep(SETTLES_S)
        while self._line is not None and len(told) < QUEUE:
            self._line.sendall(f"{self._question}\n".encode())
            answer = self._line.makefile("rb").readline().decode().strip()
            if re.match(self._none, answer):
                break
            told.append(answer)
        return "; ".join(told)

    def close(self) -> None:
        """Give the line back."""
        if self._line is not None:
            self._line.close()


def tried(walk: Walk, served: Mapping[str, Any], driver: Any) -> Iterator[tuple[str, str]]:
    """Yield each attempt of a client, and why it does not count; an empty text where it does."""
    queue = ErrorQueue(served, driver)
    queue.errors()
    try:
        for name, attempt in walk(served):
            try:
                attempt()
            except LookupError as refusal:
                # What a client cannot do in general, or not by itself, is no attempt.
                if not isinstance(refusal, KeyError | IndexError):
                    continue
                yield name, f"{type(refusal).__name__}: {refusal}"
            except NotImplementedError:
                continue
            except Exception as fault:
                yield name, f"{type(fault).__name__}: {fault}"
            else:
                yield name, queue.errors()
                continue
            queue.errors()
    finally:
        queue.close()


def main() -> int:
    """Print a line for each client, and the counts of first and of second models."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("drivers", nargs="*", help="those of these drivers alone")
    parser.add_argument("--say", action="store_true", help="say why each attempt is refused")
    figures = Figures(parser)
    options = figures.parse()
    logging.disable()
    warnings.simplefilter("ignore")
    first = {entry["driver"] for entry in shipped("sim")["instruments"].values()}
    sums: dict[str, Counter[str]] = {"first models": Counter(), "second models": Counter()}
    with tempfile.TemporaryDirectory() as folder:
        for case_name in dict.fromkeys(driver_of(name) for name in CASES):
            if options.drivers and case_name not in options.drivers:
                continue
            kind = "first models" if case_name in first else "second models"
            if case_name not in CLIENTS:
                figures.line(case_name, models=kind, client="none that pip installs")
            for client, walk in CLIENTS.get(case_name, {}).items():
                # Some clients greet on standard output.
                with served(case_name, Path(folder), client) as at, redirect_stdout(sys.stderr):
                    outcome = dict(tried(walk, at, registry.load(registry.DRIVERS, case_name)))
                refused = {name: why for name, why in outcome.items() if why}
                sums[kind]["works"] += len(outcome) - len(refused)
                sums[kind]["of"] += len(outcome)
                figures.line(
                    f"{case_name}: {client}",
                    models=kind,
                    works=len(outcome) - len(refused),
                    of=len(outcome),
                    refused=refused if options.say else sorted(refused),
                )
    for kind, counts in sums.items():
        if counts["of"] and not options.drivers:
            figures.line(kind, **counts)
    return 0


if __name__ == "__main__":
    sys.exit(main())
