"""What each key of a YAML file means, where the model itself does not say so."""

from __future__ import annotations

PLAN = {
    "plan": "version of the format",
    "extends": "another plan, by name or path relative to this file, that this one changes",
    "vars": "values that `${name}` stands for",
    "procedure": "name of the procedure; `station list procedures` gives them",
    "title": "heading of the report",
    "operator": "who runs it",
    "dut": "the device under test",
    "dut.model": "its model",
    "dut.serial": "its serial number, which also names the run folder",
    "dut.manufacturer": "its maker",
    "dut.notes": "anything else, for the report",
    "parameters": "the procedure's own parameters, see below",
    "limits": "result name to `min`, `max` or `max_abs`, for all axes or by axis",
    "decision_rule": "how a result is held against its limit",
    "references": "documents the report names",
}

PARAMETERS = {
    "rlg-magnetic-sensitivity": {
        "frequency": "drive frequency f, 0.05 Hz to 0.2 Hz",
        "amplitude": "amplitude M of the field, as a peak, 0.1 mT to 2 mT",
        "sample_interval": "interval tau0 of the gyro's samples; f tau0 is at most 0.2",
        "duration": "least length T of a record, at least 10/f; made whole cycles",
        "axes": "the axes to measure, in this order",
        "settle": "time between the start of the field and the record",
        "warm_up": "when the gyro counts as warm",
        "warm_up.slope_limit": "limit of slope magnitude + 2 u of the output over the window",
        "warm_up.window": "the stretch that is looked at",
        "warm_up.at_most": "after this time without success the run ends with code 3",
        "pulse_weight": "angle of one output pulse",
        "channel": "input of the pulse board",
        "thresholds": "where a flag is raised",
        "thresholds.not_significant": "in standard uncertainties of the sensitivity",
        "thresholds.quadrature_significant": "in standard uncertainties of the quadrature part",
        "thresholds.field_differs_from_commanded": "relative difference of the field's amplitude",
        "thresholds.gap": "in nominal sample intervals",
        "thresholds.non_integer_cycles": "in cycles of the drive",
        "thresholds.model_too_stiff": "lag-1 correlation of the residuals",
    },
    "accelerometer-magnetic-sensitivity": {
        "planes": "the planes of IA, OA, PA that gravity turns in, in this order, with a "
        "re-mounting between; `level`: the axis of rotation is vertical",
        "design": "`as_published`: a range of fields in steps; `efficient`: -B, 0 and +B at nine "
        "angles",
        "largest_field": "largest magnitude of the field, B",
        "lowest_field": "where the range of fields begins; 0 mT unless given",
        "field_step": "step of the field; a fifth of the range unless given",
        "fields": "the fields themselves, in the place of range and step",
        "angle_step": "step of the angle; 15 deg unless given, 40 deg in the efficient design",
        "angles": "the angles themselves, in the place of a step",
        "order": "`as_published`: fields rise at each angle; `palindrome`: there and back, over an "
        "even number of repeats; `random`: shuffled in each plane",
        "seed": "of the random order",
        "repeats": "how often all points of a plane are measured",
        "readings": "readings of the voltmeter at each point",
        "nplc": "integration time of a reading in periods of the mains",
        "reading_noise": "expected standard deviation of a reading, for expected uncertainties",
        "scale_factor": "nominal scale factor; the voltmeter's range follows from it",
        "dwell": "when a point has settled",
        "dwell.field_change": "successive readings of the field agree within this",
        "dwell.at_least": "least time before a point is read",
        "dwell.at_most": "after this time without success the run ends with code 3",
        "warm_up": "time between switching on and the first point",
        "degauss": "whether the coil is taken through falling fields of both signs before a plane",
        "temperature": "whether the thermometer is read at each point",
        "window": "memory of the finite-memory solution in points; chosen unless given",
        "thresholds": "where a flag is raised",
        "thresholds.not_significant": "in standard uncertainties of a magnetic coefficient",
        "thresholds.field_differs_from_commanded": "of the largest field",
        "thresholds.gap": "in nominal intervals, where there are such",
        "thresholds.model_too_stiff": "lag-1 correlation of the residuals",
        "thresholds.outlier": "in robust standard deviations of the residuals",
    },
}

CALIBRATION = {
    "calibration": "what the instrument's certificate says",
    "calibration.certificate": "its number, named in every uncertainty budget",
    "calibration.date": "when it was made",
    "calibration.due": "the last day on which it holds",
    "calibration.uncertainty": "uncertainties over ranges; the first that holds a value counts",
    "calibration.uncertainty[].quantity": "one of the quantities below",
    "calibration.uncertainty[].from": "where the range begins",
    "calibration.uncertainty[].up_to": "where the range ends",
    "calibration.uncertainty[].relative": "the part that grows with the reading",
    "calibration.uncertainty[].absolute": "the part that does not",
    "calibration.uncertainty[].coverage_factor": "k of the stated uncertainty; 1.732 for "
    "limits of a uniform distribution",
    "calibration.corrections": "known deviations: true value = gain × reading + offset",
    "calibration.corrections[].quantity": "one of the quantities below, each once",
    "calibration.corrections[].gain": "factor",
    "calibration.corrections[].offset": "what is added, with its unit",
    "calibration.notes": "anything else",
}

LIMITS = {
    "limits": "what the instrument may never exceed on this bench",
    "limits.current": "largest current; written into a supply before it is used",
    "limits.voltage": "largest voltage; written into a supply before it is used",
    "limits.slew": "fastest change of current when a coil is brought to zero",
    "limits.zero_current": "largest measured current that counts as zero",
    "limits.field": "largest field amplitude a plan may ask for",
    "limits.rms_current": "largest effective current for as long as a plan likes",
    "limits.heating": "power that a coil may turn into heat for as long as a plan likes",
    "limits.rate": "largest rate",
    "limits.acceleration": "largest angular acceleration",
    "limits.angle_low": "lowest angle",
    "limits.angle_high": "highest angle",
    "limits.temperature_low": "lowest temperature",
    "limits.temperature_high": "highest temperature",
    "limits.temperature_slew": "fastest change of temperature",
}

INSTRUMENT = {
    "driver": "name of the driver; `station list drivers` gives them",
    "address": "VISA resource name, or `socketcand://host:port/channel`; none on a simulated bench",
    "serial": "the serial number that must answer; without it any does",
    "settings": "the driver's own settings, see below",
    "simulator": "the truth about the simulated instrument, and a fixed `port` where wished",
    **LIMITS,
    **CALIBRATION,
}

BENCH = {
    "bench": "version of the format",
    "name": "name of the bench",
    "title": "heading in reports",
    "simulation": "truth of the simulated world; its presence makes the bench a simulated one",
    "instruments": "the instruments by instance",
    **{f"instruments.NAME.{key}": text for key, text in INSTRUMENT.items()},
    "interlocks": "conditions on readings under which the bench may not go on",
    "interlocks[].name": "what it is called in messages",
    "interlocks[].when": "a level or a state of a quantity of an instrument, or `any`, `all`, "
    "`not` of such conditions",
    "interlocks[].grace": "for how long the condition may hold",
    "interlocks[].period": "how often it is looked at",
    "safe_state": "the order in which instruments are brought to rest at the end of every run",
    "safe_state[].instrument": "an instance, or",
    "safe_state[].role": "all instances of a role",
    "safe_state[].within": "the time it may take",
}

DATASET = {
    "dataset": "version of the format",
    "procedure": "name of the procedure that analyses it",
    "title": "heading of the report",
    "files": "name to CSV file in the same folder",
    "conditions": "how the data were taken, see below",
}

CONDITIONS = {
    "rlg-magnetic-sensitivity": {
        "drive": "the driven axes, IA, NA, LA, one or several at once",
        "drive.NAME.frequency": "commanded frequency",
        "drive.NAME.amplitude": "commanded amplitude, as a peak",
        "sample_interval": "interval of the gyro's samples",
        "timestamp": "which instant of its interval `t_s` of a gyro sample means",
        "field_timestamp": "which instant of its averaging `t_s` means for the field",
        "field_averaging": "averaging time of the field; required unless it is instantaneous",
        "gyro_output": "which column holds the output: `rate_deg_per_h` or `counts`",
        "pulse_weight": "angle of one pulse; required where the output is counts",
    },
    "accelerometer-magnetic-sensitivity": {
        "local_gravity": "gravity at the place; `1 g` where accelerations are to be in local g",
    },
}
