"""The field at a device by that at the probe, where a bench states the geometry of its coils."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

from procedures.common.helmholtz import FieldAtDevice, box_nodes, sphere_nodes
from station.parts import Table
from station.report.numbers import format_with_uncertainty

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.instruments.coil_geometry import CoilSystem

Coil = Literal["three_axis", "dc"]


def at_device(bench: Bench, coil: Coil) -> FieldAtDevice | None:
    """Return how the field at the device follows from that at the probe; None where the bench
    file's `coil_geometry` does not say where they are.

    What uses it multiplies measured fields by its `matrix` (`helmholtz.carried`), and takes its
    `inputs` into the budget, with the derivatives `by_input`.
    """
    geometry = bench.coil_geometry
    system: CoilSystem | None = None if geometry is None else getattr(geometry, coil)
    if system is None:
        return None
    lengths_mm: dict[str, tuple[float, float]] = {}
    for what, place in (("probe", system.probe), ("device", system.device)):
        for axis, value in zip("xyz", place.point_mm, strict=True):
            lengths_mm[f"{what}_{axis}_mm"] = value, place.uncertainty_mm
    for axis, pair in system.pairs.items():
        lengths_mm[f"coil_{axis}_radius_mm"] = pair.radius_mm, pair.radius_uncertainty_mm
        lengths_mm[f"coil_{axis}_spacing_mm"] = pair.spacing_mm, pair.spacing_uncertainty_mm
    box, sphere_mm = system.device.box, system.device.sphere_mm
    nodes, weights = sphere_nodes(sphere_mm or 0.0) if box is None else box_nodes(box.edges_mm)
    return FieldAtDevice(tuple(system.pairs), lengths_mm, nodes, weights)


def entry(at: FieldAtDevice | None, coil: str) -> Mapping[str, Any]:
    """Return what a result says of the correction; nothing where there is none."""
    if at is None:
        return {}
    ratio, u = at.ratio(coil)
    return {"field_at_device": {"ratio": ratio, "standard_uncertainty": u}}


def table(at: FieldAtDevice) -> Table:
    """Return the correction of each coil's field and where its uncertainty comes from."""
    u = {quantity.name: quantity.standard_uncertainty or 0.0 for quantity in at.inputs}
    rows = []
    for k, coil in enumerate(at.coils):
        value_text, u_text = format_with_uncertainty(*at.ratio(coil))
        parts = {name: float(slope[k]) * u[name] for name, slope in at.by_input(coil).items()}
        causes = [
            sum(part**2 for name, part in parts.items() if name.startswith(begin)) ** 0.5
            for begin in ("probe_", "device_", "coil_", "device_volume")
        ]
        causes[1] = max(causes[1] ** 2 - causes[3] ** 2, 0.0) ** 0.5
        rows.append([coil, value_text, u_text, *(f"{1e6 * cause:.2g}" for cause in causes)])
    return Table(
        "The field at the device",
        "The mean field of each coil over the device by that at the probe, from the geometry that "
        "the bench file states. The measured fields are multiplied by it, and what one coil makes "
        "along the axis of another at the probe is taken off. Uncertainties are standard; the last "
        "columns say what makes them, in ppm.",
        [
            "coil",
            "device over probe",
            "u",
            "place of the probe",
            "place of the device",
            "coil",
            "volume of the device",
        ],
        rows,
    )
