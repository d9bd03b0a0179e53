"""What tests stand on: a state folder of their own, where no test knows of another; a bench."""

from __future__ import annotations

import atexit
import hashlib
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from station.cli import ONE_BLAS_THREAD

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # Started in the background of a shell: the runs of the tests are to hear Ctrl-C all the same.
    signal.signal(signal.SIGINT, signal.default_int_handler)
os.environ.update(ONE_BLAS_THREAD)  # as a run has it; NumPy reads it when it is first imported
os.environ["LC_ALL"] = "C.UTF-8"  # English, whatever language this computer speaks


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> int | None:
    """Run the whole session as one thing that ends as one; see `own_namespaces`."""
    from leftovers import SESSION, begin_session
    from own_namespaces import is_inside, run_inside

    called, option = config.invocation_params, config.option
    if is_inside() or SESSION in os.environ:
        return None
    if called.plugins or sys.gettrace():  # a debugger or coverage is at work in this process
        begin_session()
        return None
    capture: Any = config.pluginmanager.getplugin("capturemanager")
    capture.stop_global_capturing()  # whoever runs inside captures, and has the real input
    alone_at_a_terminal = not getattr(option, "numprocesses", None) and os.isatty(0)
    code = run_inside(
        as_this_process(*map(str, called.args)),
        kept_visible(config),
        patient=bool(option.usepdb or option.trace or alone_at_a_terminal),
    )
    if code is None:
        begin_session()
        capture.start_global_capturing()
        capture.suspend_global_capture()
    return code


def pytest_configure() -> None:
    if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):
        # The code's folders stay as they are; yet of hundreds of processes only the first compiles.
        compiled = tempfile.mkdtemp(prefix="station-tests-compiled-")
        os.environ["PYTHONPYCACHEPREFIX"] = compiled
        atexit.register(shutil.rmtree, compiled, ignore_errors=True)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mix the files of the campaigns: those of one folder all wait, or all compute, at once."""
    if config.option.markexpr == "campaign":
        items.sort(key=lambda item: hashlib.sha256(item.nodeid.split("::")[0].encode()).digest())


def as_this_process(*arguments: str) -> list[str]:
    """Return the command of pytest with the options and the path of this interpreter."""
    options = subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined]
    code = f"import runpy, sys; sys.path[:] = {sys.path!r}\n"
    code += "runpy.run_module('pytest', run_name='__main__')"
    return [sys.executable, *options, "-c", code, *arguments]


def kept_visible(config: pytest.Config) -> list[Path]:
    """Return the folders of code, interpreter and files that the command line names."""
    called = config.invocation_params
    words = [*map(str, called.args), *shlex.split(os.environ.get("PYTEST_ADDOPTS", ""))]
    words.append(os.environ.get("PYTEST_DEBUG_TEMPROOT", ""))
    kept = [config.rootpath, called.dir, Path(sys.prefix), Path(sys.base_prefix)]
    kept += [Path(path) for path in sys.path if Path(path).is_dir()]
    for word in words:
        before, equals, after = word.partition("::")[0].partition("=")
        path = called.dir / (after if equals else before).lstrip("@")
        while not path.is_dir():
            path = path.parent
        kept.append(path)
    return sorted({*map(Path.absolute, kept), *map(Path.resolve, kept)})


@pytest.fixture(autouse=True, scope="session")
def state_folder_of_the_tests(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Keep what the station remembers between runs away from the user's own folder."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("state")
        patch.setenv("XDG_STATE_HOME", str(folder))
        yield folder


@pytest.fixture(autouse=True)
def no_trip_of_another_test(state_folder_of_the_tests: Path) -> Iterator[None]:
    """Let a bench that tripped in one test be used in the next: one failure is one failure."""
    yield
    shutil.rmtree(state_folder_of_the_tests / "inertial-station" / "tripped", ignore_errors=True)


@pytest.fixture(scope="session")
def one_axis_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of one axis, for tests that look at it or change a copy of it."""
    from campaign_helpers import finished_run
    from shared_runs import made_once

    return made_once(tmp_path_factory, "one-axis", lambda folder: finished_run(folder, ["IA"]))


@pytest.fixture(scope="session")
def two_axes_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of two axes, of which one has a limit; not to be changed."""
    from campaign_helpers import finished_run
    from shared_runs import made_once

    axes = ["IA", "LA"]
    return made_once(tmp_path_factory, "two-axes", lambda folder: finished_run(folder, axes))


@pytest.fixture(scope="session")
def postgresql() -> Iterator[Any]:
    """A server of PostgreSQL, one for each process of the tests that asks for it."""
    from postgresql_server import server_or_skip

    with server_or_skip() as server:
        yield server


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Which database keeps the history of a test: the file beside the runs, or one of a server."""
    if request.param == "postgresql":
        url = request.getfixturevalue("postgresql").new_database()
        monkeypatch.setenv("STATION_HISTORY", url)
    return str(request.param)


@pytest.fixture
def clock() -> Any:
    """A virtual clock."""
    from station.clock import VirtualClock

    return VirtualClock()


@pytest.fixture
def bench(clock: Any) -> Iterator[Any]:
    """The bench of the tests of simulators, served on virtual time."""
    from sim_bench import served

    with served(clock) as simulation:
        yield simulation


@pytest.fixture
def board(bench: Any, clock: Any) -> Iterator[Any]:
    """A raw client of that bench's pulse board."""
    from sim_bench import Frames

    with Frames(bench, clock) as client:
        yield client


@pytest.fixture(scope="session")
def run_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The finished run of a procedure's plan in its short form, made once; not to be changed."""
    from shared_runs import made_once
    from short_forms import SHORT_FORMS

    from station.cli.validating import read_bench_named, read_plan_for
    from station.runner.execute import Request, execute

    def run(name: str) -> Path:
        def make(folder: Path) -> Path:
            bench = read_bench_named("sim")
            plan = read_plan_for(name, bench, SHORT_FORMS[name])
            return execute(Request(plan, bench, folder, quiet=True, report=False)).folder

        return made_once(tmp_path_factory, name, make)

    return run


# Every run tries the same examples, so that a failure is the change's and not the day's.
settings.register_profile(
    "same-examples", derandomize=True, deadline=None, max_examples=60, print_blob=False
)
settings.load_profile("same-examples")
