"""The examples of a documentation page: taken out of it, put into a folder, and run there.

A comment on the line before a code block says what the block is:

    <!-- file: NAME -->             the file NAME in the page's folder
    <!-- more: NAME -->             lines at the end of that file
    <!-- replace: KEY in OLD as NEW -->   NEW is the bench OLD with the entry KEY of its instruments
                                    replaced by the block
    <!-- run -->                    commands (`$ `) with what they print; `…` stands for anything
    <!-- run: exit N -->            the same; the last command ends with code N
    <!-- background: FILE -->       a command that runs until the page ends; it writes FILE
    <!-- python -->                 a script, run by the interpreter
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from places import ROOT

BLOCK = re.compile(
    r"^<!-- ([a-z]+)(?:: ([^\n]*?))? -->\n```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL
)
MARKS = {"file", "more", "replace", "run", "background", "python"}


@dataclass(frozen=True)
class Example:
    """One marked block of a page."""

    mark: str
    detail: str
    language: str
    text: str
    line: int


def examples(page: Path) -> list[Example]:
    """Return the marked blocks of a page in order."""
    text = page.read_text(encoding="utf-8")
    return [
        Example(
            found.group(1),
            found.group(2) or "",
            found.group(3),
            found.group(4),
            text[: found.start()].count("\n") + 1,
        )
        for found in BLOCK.finditer(text)
        if found.group(1) in MARKS
    ]


@dataclass
class Workshop:
    """A folder like a fresh clone, in which a page is carried out."""

    folder: Path
    background: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for name in ("benches", "plans"):
            shutil.copytree(ROOT / "config" / name, self.folder / "config" / name)
        shutil.copytree(ROOT / "tests" / "data", self.folder / "tests" / "data")

    def carry_out(self, page: Path) -> None:
        """Do what a page says, block by block; AssertionError names page and line."""
        try:
            for example in examples(page):
                where = f"{page.name}:{example.line}"
                getattr(self, f"_{example.mark}")(example, where)
        finally:
            for process in self.background:
                process.send_signal(signal.SIGINT)
                process.wait(timeout=30)

    def _file(self, example: Example, where: str) -> None:
        path = self.folder / example.detail
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(example.text, encoding="utf-8")
        if path.name == "pyproject.toml":
            make_known(tomllib.loads(example.text)["project"], self.folder)

    def _more(self, example: Example, where: str) -> None:
        with (self.folder / example.detail).open("a", encoding="utf-8") as file:
            file.write(example.text)

    def _replace(self, example: Example, where: str) -> None:
        found = re.fullmatch(r"(\S+) in (\S+) as (\S+)", example.detail)
        assert found, where
        key, old, new = found.groups()
        text = (self.folder / old).read_text(encoding="utf-8")
        entry = re.compile(rf"^  {re.escape(key)}:\n(?:(?: {{4,}}.*)?\n)*", re.MULTILINE)
        changed, count = entry.subn(lambda _: example.text + "\n", text, count=1)
        assert count == 1, f"{where}: {old} has no {key}"
        (self.folder / new).write_text(changed, encoding="utf-8")

    def _run(self, example: Example, where: str) -> None:
        commands = commands_of(example.text)
        wanted = int(example.detail.removeprefix("exit ") or 0)
        for number, (command, printed) in enumerate(commands):
            done = subprocess.run(
                ["bash", "-c", command],
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                encoding="utf-8",
                env=self.environment(),
                timeout=300,
                check=False,
            )
            last = number == len(commands) - 1
            assert done.returncode == (wanted if last else 0), f"{where}: {command}\n{done.stdout}"
            if printed:
                told = f"{where}: {command}\nprints\n{done.stdout}\nand not\n{printed}"
                assert same(printed.splitlines(), done.stdout.splitlines()), told

    def _python(self, example: Example, where: str) -> None:
        done = subprocess.run(
            [sys.executable, "-c", example.text],
            cwd=self.folder,
            capture_output=True,
            text=True,
            encoding="utf-8",
            env=self.environment(),
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, f"{where}\n{done.stderr}"

    def _background(self, example: Example, where: str) -> None:
        ((command, _),) = commands_of(example.text)
        inner = command.removesuffix("&").strip()
        self.background.append(
            subprocess.Popen(
                ["bash", "-c", f"exec {inner}"],
                cwd=self.folder,
                stdin=subprocess.PIPE,  # as a terminal's, it closes with this test
                stderr=subprocess.DEVNULL,
                env=self.environment(),
            )
        )
        written = self.folder / example.detail
        for _ in range(600):
            if written.is_file() and written.read_text(encoding="utf-8").endswith("\n"):
                return
            time.sleep(0.05)
        raise AssertionError(f"{where}: {command} writes nothing")

    def environment(self) -> dict[str, str]:
        """Return the environment of a user whose commands and packages are found first."""
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        kept = {name: value for name, value in os.environ.items() if name != "CI"}
        return {**kept, "PATH": path, "PYTHONPATH": str(self.folder), "COLUMNS": "80"}


def make_known(project: dict[str, object], folder: Path) -> None:
    """Make a package of a folder known by its entry points, as an editable install would."""
    info = folder / f"{project['name']}-{project['version']}.dist-info"
    info.mkdir()
    head = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (info / "METADATA").write_text(head, encoding="utf-8")
    groups = project.get("entry-points", {})
    assert isinstance(groups, dict)
    lines = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
        for group, entries in groups.items()
    ]
    (info / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")


def commands_of(text: str) -> list[tuple[str, str]]:
    """Return the commands of a console block, each with what it is said to print."""
    found: list[tuple[str, str]] = []
    for line in text.splitlines():
        if line.startswith("$ "):
            found.append((line[2:], ""))
        elif found:
            command, printed = found[-1]
            found[-1] = (command, f"{printed}{line}\n")
    return found


def same(expected: list[str], printed: list[str]) -> bool:
    """Whether lines are as expected: a line `…` is any lines, `…` within a line anything."""
    if not expected:
        return not printed
    if expected[0].strip() == "…":
        return any(same(expected[1:], printed[skip:]) for skip in range(len(printed) + 1))
    if not printed:
        return False
    parts = [re.escape(" ".join(part.split())) for part in expected[0].split("…")]
    pattern = r" ?" + " ?.*".join(parts) + r" ?"
    found = re.fullmatch(pattern, " ".join(printed[0].split()))
    return found is not None and same(expected[1:], printed[1:])
