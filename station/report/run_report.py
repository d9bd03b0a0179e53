"""The report of a run, from its folder alone, and that of an imported dataset."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from station.fields import to_yaml_data
from station.instruments.bench import Bench
from station.parts import Part
from station.procedure import procedure_of
from station.record.events import LEFT_FOR_THE_END, Event, head_of_run
from station.record.folder import RunFolder
from station.record.layout import versions
from station.recorded import left_unverified, read_plan_and_bench
from station.report.context import (
    InstrumentRow,
    PromptRow,
    ReportContext,
    Row,
    SafeStateRow,
    StepRow,
)
from station.report.html import render_html
from station.results import ResultDocument
from station.safety.interlocks.reading import CHAIN
from station.texts import IN_ENGLISH, Texts

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset


ASKED_LAST = "asked once bench and results were done"


def report_of_run(
    folder: RunFolder,
    document: ResultDocument,
    parts: Sequence[Part],
    texts: Texts = IN_ENGLISH,
) -> str:
    """Return the report of a run as one HTML page."""
    return render_html(document, context_of_run(folder), parts, texts)


def context_of_run(folder: RunFolder) -> ReportContext:
    """Return what the report of a run shows beside the results."""
    plan, bench = read_plan_and_bench(folder)
    procedure = procedure_of(plan.procedure)
    facts = folder.run_facts()
    simulated = bench.is_simulated
    return ReportContext(
        title=procedure.title,
        source=procedure.source,
        started_utc=time_of_day(facts["started_utc"]),
        ended_utc=time_of_day(facts.get("ended_utc")),
        operator=plan.operator,
        dut=dut_rows(to_yaml_data(plan.dut)),
        decision_rule=plan.decision_rule,
        bench_safe=not left_unverified(folder, bench),
        plan_name=plan.title or plan.procedure,
        parameters=tuple(flat_rows(to_yaml_data(plan.parameters))),
        bench_name=bench.title or bench.name,
        simulated=simulated,
        simulation=simulation_sentences(bench, speed_of(folder)) if simulated else (),
        instruments=tuple(instrument_rows(folder, bench)),
        steps=tuple(step_rows(folder)),
        prompts=tuple(prompt_rows(folder)),
        safe_state=tuple(
            SafeStateRow(
                outcome["instrument"] + ("" if outcome.get("used", True) else ", not used"),
                outcome["verified"],
                outcome["read_back"],
                outcome["took_s"],
            )
            for event in folder.events_of("safe-state")
            for outcome in rest_of(event)
        ),
        assumptions=procedure.assumptions,
        versions=tuple(version_rows(facts)),
        reproduce=f"station analyse {folder.path.name} --compare",
        notes=tuple(notes_of(bench)),
        references=tuple(plan.header.references.items()),
        run=folder.path.resolve().name,
        head=head_of_run(folder.path),
        laboratory=bench.file.laboratory.name if bench.file.laboratory else "",
    )


def prompt_rows(folder: RunFolder) -> Iterator[PromptRow]:
    """Yield what was asked and answered, then what was left for after the results."""
    for event in folder.events_of("prompt"):
        details = event.details
        yield PromptRow(details["id"], details["text"], details["answer"], details["by"])
    for event in folder.events_of(LEFT_FOR_THE_END):
        yield PromptRow(event.details["id"], event.details["text"], ASKED_LAST, "")


def rest_of(event: Event) -> list[dict[str, Any]]:
    """Return how the instruments of a run came to rest, and how those outside it were read."""
    used = [outcome for outcome in event.details["outcomes"] if outcome.get("used", True)]
    return [*used, *event.details.get("outside", ())]


def time_of_day(iso: str | None) -> str | None:
    """Return a UTC time as it is to be read."""
    return iso[:19].replace("T", " ") if iso else None


def dut_rows(dut: Mapping[str, Any]) -> dict[str, str]:
    """Return what the plan says of the device under test."""
    return {str(name): str(value) for name, value in dut.items() if value is not None}


def flat_rows(data: Mapping[str, Any], before: str = "") -> Iterator[Row]:
    """Yield nested parameters as rows of dotted name and text."""
    for name, value in data.items():
        if isinstance(value, Mapping):
            yield from flat_rows(value, f"{before}{name}.")
        elif isinstance(value, list | tuple):
            yield f"{before}{name}", ", ".join(str(part) for part in value)
        elif value is not None:
            yield f"{before}{name}", str(value)


def speed_of(folder: RunFolder) -> float | None:
    """Return how many times as fast as real the time of a run went, None where it was virtual."""
    return folder.state.speed or None


def simulation_sentences(bench: Bench, speed: float | None) -> tuple[str, ...]:
    """Return what was simulated, in sentences; `speed` is None on virtual time."""
    instruments = ", ".join(f"{name} ({entry.driver})" for name, entry in bench.instruments.items())
    return (
        f"Every instrument was simulated: {instruments}. Each answered the same driver that a real "
        "one would, on its own wire protocol.",
        "The device under test, the coils and their field were computed from the truth that stands "
        "under “simulation” in the bench file; the analysis does not read it.",
        "Time was virtual: waiting was skipped, nothing else."
        if speed is None
        else f"Time was that of the computer, {speed:g} times as fast.",
        "Physical acts were done by the simulated world. Certificates and due dates are invented.",
    )


def notes_of(bench: Bench) -> Iterator[str]:
    """Yield what the bench lacks and the reader should know."""
    if CHAIN not in bench.instruments:
        yield (
            f"The bench {bench.name} has no {CHAIN}: whether an emergency stop or a door switch "
            "opened while this was measured could not be seen by the station."
        )


def instrument_rows(folder: RunFolder, bench: Bench) -> Iterator[InstrumentRow]:
    """Yield each instrument that took part, as it identified itself, of a resumed run once."""
    identified = (
        (*(event.details[key] for key in ("instrument", "maker", "model", "serial", "firmware")),)
        for event in folder.events_of("identified")
    )
    for name, maker, model, serial, firmware in dict.fromkeys(identified):
        calibration = bench.instruments[name].calibration
        yield InstrumentRow(
            name=name,
            role=name.split(".")[0].replace("_", " "),
            model=f"{maker} {model}".strip(),
            serial=serial,
            firmware=firmware,
            certificate=(calibration.certificate or "") if calibration else "",
            due_date=str(calibration.due) if calibration else "",
            overdue=calibration.overdue(folder.last_day) if calibration else False,
        )


def step_rows(folder: RunFolder) -> Iterator[StepRow]:
    """Yield each step with its times, finished or not."""
    finished = {event.details["step"]: event.time_s for event in folder.events_of("step-finished")}
    for event in folder.events_of("step-started"):
        number = event.details["step"]
        ended_s = finished.get(number)
        yield StepRow(
            number,
            event.details["title"],
            event.time_s,
            None if ended_s is None else ended_s - event.time_s,
            "done" if ended_s is not None else "not finished",
        )


def version_rows(facts: Mapping[str, Any]) -> Iterator[Row]:
    """Yield the software and the computer of a run."""
    yield "station", str(facts["station"])
    if facts.get("git_commit"):
        yield "git commit", str(facts["git_commit"])
    yield "Python", str(facts["python"])
    yield from ((name, str(number)) for name, number in facts["packages"].items() if number)
    for package in sorted({*facts.get("drivers", {}).values()}):
        drivers = [name for name, other in facts["drivers"].items() if other == package]
        yield f"drivers of {package}", ", ".join(drivers)
    yield "computer", f"{facts['host']}, {facts['system']}"


def report_of_dataset(raw: RawDataset, document: ResultDocument, parts: Sequence[Part]) -> str:
    """Return the report of an imported dataset as one HTML page."""
    procedure = procedure_of(raw.procedure)
    context = ReportContext(
        title=procedure.title,
        source=procedure.source,
        subject=f"imported dataset {raw.folder.name}",
        parameters=tuple(flat_rows(raw.document.data["conditions"])),
        assumptions=(
            "The data were imported: no calibration records came with them, so the uncertainties "
            "hold type A and what the conditions state, no more.",
            *procedure.assumptions,
        ),
        versions=tuple(version_rows(versions())),
        reproduce=f"station analyse {raw.folder.name}",
    )
    return render_html(document, context, parts)
