"""CAN interfaces of python-can as a bench file names them: `can://INTERFACE/CHANNEL?SETTING=VALUE`.

Names of interfaces, channels and settings are python-can's, from its documentation of each
interface. An interface knows its settings and no others.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Annotated, Any, ClassVar, Literal
from urllib.parse import parse_qsl

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

SCHEME = "can"

AnyRate = Annotated[int, Field(ge=5_000, le=1_000_000, description="bits in a second")]
Number = Annotated[int, Field(ge=0, le=255)]
Stamps = Literal["kernel", "adapter", "computer"]


class Interface(BaseModel):
    """What python-can is given for an interface; the channel is the path of the address."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    stamps: ClassVar[Stamps] = "computer"
    """Who stamps a frame: the kernel, the adapter, or python-can when it takes the frame."""


class SocketCan(Interface):
    """The bit rate is the system's: `ip link set can0 up type can bitrate 500000`."""

    stamps: ClassVar[Stamps] = "kernel"
    channel: str = Field(pattern=r"^[^/\s]{1,15}$")


class Pcan(Interface):
    """PCAN-Basic of PEAK-System; it takes the bit rates that it has names for."""

    stamps: ClassVar[Stamps] = "adapter"
    channel: str = Field(pattern=r"^PCAN_(ISA|DNG|PCI|USB|PCC|LAN)BUS\d{1,2}$")
    bitrate: int = 500_000
    device_id: int | None = Field(None, ge=0, le=0xFFFFFFFF)

    @field_validator("bitrate")
    @classmethod
    def _has_a_name(cls, rate: int) -> int:
        return one_of(rate, PCAN_RATES)


class Kvaser(Interface):
    """CANlib of Kvaser."""

    stamps: ClassVar[Stamps] = "adapter"
    channel: Number
    bitrate: AnyRate = 500_000


class Vector(Interface):
    """XL driver library of Vector; `app_name` is an application of Vector Hardware Config."""

    stamps: ClassVar[Stamps] = "adapter"
    channel: Number
    bitrate: AnyRate = 500_000
    app_name: str = Field("CANalyzer", min_length=1)
    serial: int | None = Field(None, ge=0)


class Ixxat(Interface):
    """VCI of HMS."""

    stamps: ClassVar[Stamps] = "adapter"
    channel: Number
    bitrate: AnyRate = 500_000
    unique_hardware_id: str | None = Field(None, min_length=1)


class Slcan(Interface):
    """An adapter that speaks the SLCAN text protocol on a serial port; its bit rates are S0 to S8.

    Without `bitrate` the adapter keeps its own.
    """

    channel: str = Field(pattern=r"^(/.+|COM\d+)$")
    bitrate: int | None = None
    tty_baudrate: int = Field(115_200, ge=1_200, le=4_000_000)
    sleep_after_open: float | None = Field(None, ge=0, le=10)

    @field_validator("bitrate")
    @classmethod
    def _has_a_letter(cls, rate: int | None) -> int | None:
        return rate if rate is None else one_of(rate, SLCAN_RATES)


class Virtual(Interface):
    """A bus within one process: for tests."""

    channel: str = Field(min_length=1)


class UdpMulticast(Interface):
    """Frames in multicast datagrams of a local network."""

    stamps: ClassVar[Stamps] = "kernel"
    channel: str
    port: int = Field(43113, ge=1, le=65535)
    hop_limit: int = Field(1, ge=0, le=255)

    @field_validator("channel")
    @classmethod
    def _is_a_group(cls, channel: str) -> str:
        if not ip_address(channel).is_multicast:
            raise ValueError("is no multicast group")
        return channel


SLCAN_RATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 750_000, 1_000_000)
PCAN_RATES = (
    *(5_000, 10_000, 20_000, 33_000, 47_000, 50_000, 83_000, 95_000, 100_000),
    *(125_000, 250_000, 500_000, 800_000, 1_000_000),
)
INTERFACES: dict[str, type[Interface]] = {
    "socketcan": SocketCan,
    "pcan": Pcan,
    "kvaser": Kvaser,
    "vector": Vector,
    "ixxat": Ixxat,
    "slcan": Slcan,
    "virtual": Virtual,
    "udp_multicast": UdpMulticast,
}
"""`socketcand://host:port/channel` is an address of its own."""


@dataclass(frozen=True)
class CanAddress:
    """An interface of python-can, what it is opened with, and who stamps its frames."""

    interface: str
    settings: dict[str, Any]
    stamps: Stamps


def one_of(rate: int, rates: tuple[int, ...]) -> int:
    """Return a bit rate that is one of `rates`; raises ValueError for another."""
    if rate not in rates:
        raise ValueError(f"write one of {', '.join(map(str, rates))}")
    return rate


def can_address(address: str) -> CanAddress:
    """Return what `can://INTERFACE/CHANNEL?SETTING=VALUE` says; ValueError, in one sentence."""
    matched = re.fullmatch(r"can://([^/?]*)(?:/([^?]*))?(?:\?(.*))?", address.strip(), re.DOTALL)
    name, channel, query = matched.groups(default="") if matched else ("", "", "")
    if name == "socketcand":
        raise ValueError("write socketcand://host:port/channel for a bus behind socketcand")
    model = INTERFACES.get(name)
    if model is None:
        raise ValueError(
            f"there is no CAN interface '{name}'; "
            f"write can://INTERFACE/CHANNEL with one of {', '.join(INTERFACES)}"
        )
    if not channel:
        raise ValueError(f"no channel is named; write can://{name}/CHANNEL")
    known = [name for name in model.model_fields if name != "channel"]
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True) if query else []
    except ValueError:
        raise ValueError(f"'?{query}' is no list of settings; write ?NAME=VALUE&…") from None
    given = dict(pairs)
    for key, _ in pairs:
        if key not in known:
            knows = ", ".join(known) if known else "none"
            raise ValueError(f"the interface {name} has no setting '{key}'; it knows {knows}")
    if len(given) < len(pairs):
        raise ValueError("a setting stands there twice; write it once")
    try:
        read = model.model_validate({"channel": channel, **given})
    except ValidationError as error:
        wrong = error.errors(include_url=False)[0]
        key = str(wrong["loc"][0])
        why = wrong["msg"].removeprefix("Value error, ")
        what = f"'{wrong['input']}' as {key} of {name} is wrong: {why}"
        raise ValueError(what) from None
    return CanAddress(name, read.model_dump(exclude_none=True), model.stamps)
