"""Asking libraries of others in a process of its own: one that hangs or crashes ends with it."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

TRACEBACK = "Traceback (most recent call last)"


def asked_alone(program: str, argument: str, within_s: float) -> tuple[list[Any], str]:
    """Return what a Python program prints, a JSON value a line, and why there is no more of it.

    The program gets one argument; it ends, or is ended, within `within_s` of real time. Lines that
    it printed before are kept. The reason is empty where it ended well.
    """
    try:
        ended = subprocess.run(
            [sys.executable, "-c", program, argument],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=within_s,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        return values_of(error.stdout or b""), f"no answer in {within_s:g} s"
    except OSError as error:
        return [], str(error)
    if ended.returncode == 0:
        return values_of(ended.stdout), ""
    said = ended.stderr.decode("utf-8", "replace").strip()
    last = said.splitlines()[-1] if said else f"it ended with code {ended.returncode}"
    if said.startswith(TRACEBACK):  # which ends with a class and what the error says
        last = last.partition(": ")[2] or "it gives no reason"
    return values_of(ended.stdout), last


def values_of(printed: bytes) -> list[Any]:
    """Return the JSON values of what was printed; a line that is none is left out."""
    values = []
    for line in printed.decode("utf-8", "replace").splitlines():
        try:
            values.append(json.loads(line))
        except ValueError:
            continue
    return values
