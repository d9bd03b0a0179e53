"""Which CAN interfaces python-can detects on this computer, each asked in a process of its own.

A maker's library that hangs or crashes ends with its process and costs its own lines only.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

from station.instruments.own_process import asked_alone

DETECTED = ("socketcan", "pcan", "kvaser", "vector", "ixxat")
"""`slcan` adapters are serial ports; `virtual` and `udp_multicast` have nothing attached."""
WITHIN_S = 8.0
DETECT = """\
import json, sys, can
found = can.detect_available_configs(sys.argv[1])
print(json.dumps([str(one["channel"]) for one in found]))
"""


def can_interfaces(
    interfaces: Iterable[str] = DETECTED, *, detect: str = DETECT, within_s: float = WITHIN_S
) -> list[tuple[str, str]]:
    """Return address and description of each channel; of an interface that fails, why.

    `detect` is the Python program that prints the channels of the interface it is given; it ends,
    or is ended, within `within_s` of real time.
    """

    def lines(interface: str) -> list[tuple[str, str]]:
        address = f"can://{interface}/"
        listed, why = asked_alone(detect, interface, within_s)
        if why or not listed:
            return [
                (f"{address}CHANNEL", f"the detection of {interface} fails ({why or 'silent'})")
            ]
        return [(f"{address}{number}", f"CAN interface {interface}") for number in listed[-1]]

    asked = list(interfaces)
    with ThreadPoolExecutor(len(asked)) as pool:
        return [line for listed in pool.map(lines, asked) for line in listed]
