"""What each key of a YAML file means, where the model itself does not say so."""

from __future__ import annotations

from station.roles.role import limits

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
    "commissioning": {
        "checks": "the parts that are walked",
        "coils": "the part of coils, their supplies and the field probe",
        "coils.field": "steady field of each coil, of either sense",
        "coils.record": "length of each record of the field",
        "coils.settle": "time between a change of the field and its record",
        "coils.turn_probe": "whether a person turns a probe of one axis along x, y and z",
        "coils.ambient": "the ambient field along the bench's axes, from a map and a compass; it "
        "decides whether a coil or an axis of the probe is reversed",
        "coils.ambient.x": "component along x",
        "coils.ambient.y": "component along y",
        "coils.ambient.z": "component along z",
        "coils.ambient.standard_uncertainty": "of each component",
    },
    "rlg-magnetic-sensitivity": {
        "excitation": "`sequential`: one coil after the other, as published; `simultaneous`: all "
        "at once, each at its own frequency",
        "frequency": "drive frequency f, 0.05 Hz to 0.2 Hz; with simultaneous excitation that of "
        "the first axis, which may be left out",
        "frequencies": "with simultaneous excitation the frequency of each axis, in the place of "
        "`frequency`; chosen unless given, and made whole cycles",
        "amplitude": "amplitude M of the field, as a peak, 0.1 mT to 2 mT",
        "sample_interval": "interval tau0 of the gyro's samples; f tau0 is at most 0.2",
        "duration": "least length T of a record, at least 10/f; made whole cycles",
        "stop": "what ends a record after `duration` and before `at_most`; a record has a fixed "
        "length unless given",
        "stop.uncertainty": "standard uncertainty of each sensitivity that is good enough",
        "stop.early_decision": "whether it is enough that each value is clear of its limit",
        "stop.at_most": "longest time of a record",
        "checks": "what is measured besides: `linearity` at half the amplitude, `frequency` at "
        "another one, `background` with the coils off",
        "axes": "the axes to measure, in this order",
        "undriven_sensitivity": "largest sensitivity of an axis that is not driven; it stands in u "
        "as far as the measured field leans that way",
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
        "thresholds.checks_differ": "of a check, in standard uncertainties of the difference",
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
    "serf-nonorthogonality": {
        "pump_axis": "the coil along which the pump light passes",
        "probe_axis": "the coil along which the probe light passes; another one",
        "single_axis": "the coil of the shots with one field; the third one, which is the only one "
        "whose field alone shows a precession",
        "nuclear_spin": "of the alkali: 1.5 for K, Rb-87 and Na, 2.5 for Rb-85, 3.5 for Cs",
        "shots": "`reversal`: fourteen, every polarity; `as_published`: four, with coil constants "
        "known and no residual field",
        "coil_constants": "`nominal`: each coil has a factor, that of the first shot's coil is "
        "one; "
        "`known`: those of the bench file are right to their stated uncertainty",
        "field": "of each coil; chosen from the cell's rates unless given",
        "fields": "a field for each coil in place of one for all",
        "fields.x": "of coil x",
        "fields.y": "of coil y",
        "fields.z": "of coil z",
        "relaxation_rate": "R of the electrons with the pump off; needed to choose a field",
        "exchange_rate": "rate of spin exchange; needed to choose a field",
        "gyromagnetic_ratio": "of the electron; the source prints its unit as nT/Hz",
        "sample_rate": "of the digitizer, at least four times the fastest precession",
        "record": "time that is recorded after the field comes; five 1/e times lose nothing",
        "full_scale": "largest voltage of the signal",
        "pump": "time for which the vapour is pumped before a shot",
        "repeats": "how often a bad shot is taken again",
        "mains_frequency": "of a pick-up that is fitted; none unless given",
        "gyro_was_running": "whether nuclei are polarised, so that step 1 must be done",
        "depolarise": "step 1",
        "depolarise.gradient": "along z; published 2000 nT/cm",
        "depolarise.duration": "how long it acts before the nuclei are looked for",
        "depolarise.rounds": "how often it acts; after that the run ends with code 3",
        "nulling": "step 2",
        "nulling.tolerance": "magnitude of residual field that is small enough",
        "nulling.at_most": "a larger one is that of polarised nuclei and not nulled",
        "nulling.rounds": "how often it is looked for; the rest is reported",
        "thresholds": "where a flag is raised",
        "thresholds.residual_field_large": "magnitude of the residual field",
        "thresholds.few_cycles": "cycles within the 1/e time of a shot",
        "thresholds.chirp": "relative fall of the frequency over the decay",
        "thresholds.gap": "in nominal sample intervals",
        "thresholds.model_too_stiff": "lag-1 correlation of a shot's residuals",
    },
    "fog-scale-factor-temperature": {
        "outside_published_range": "whether soak, ramp and interval may lie outside the published "
        "ranges; the report repeats what does",
        "temperature_range": "lowest and highest temperature of the gyro",
        "soak": "time at the lowest temperature, from when the chamber has reached it; published "
        "4 h to 6 h",
        "ramp_rate": "how fast the chamber rises; published 0.5 degC to 1 degC in 5 min",
        "set_interval": "from one set of turns to the next; published 10 min",
        "axes": "the axes that are turned up, in this order",
        "turns": "`as_published`: +360 deg; `pairs`: +360 deg, -360 deg, which cancels the gyro's "
        "bias; `+--+`: cancels its drift, too",
        "settle": "time at rest before and after each turn, within its readings",
        "pause": "time between two turns about an axis",
        "reorientation": "time to turn an axis up",
        "turn_acceleration": "of the table",
        "turn_rate": "of the turns; refused where a set does not fit the interval",
        "latitude": "of the bench, north positive; the navigator takes the earth's rate off by it",
        "alignment": "expected time of the initial alignment",
        "alignment_at_most": "after this time without alignment the run ends with code 3",
        "warm_up": "when the gyro's self-heating counts as over",
        "warm_up.slope_limit": "limit of slope magnitude + 2 u of its temperature over the window",
        "warm_up.window": "the stretch that is looked at",
        "warm_up.at_most": "after this time without success the run ends with code 3",
        "random_rotation": "time of the rotation of step 1, recorded before the ramp",
        "soaked_within": "the chamber has reached a temperature when it is this near",
        "chamber_at_most": "after this time without reaching it the run ends with code 3",
        "navigator_rate": "outputs of the navigator in a second",
        "heading_resolution": "of the navigator, for expected uncertainties",
        "angle_random_walk": "of the gyros, for expected uncertainties",
        "turntable_accuracy": "of a full turn, for expected uncertainties",
        "gyro_bias": "specification of the gyros' bias as a standard uncertainty; required where "
        "turns have one sense",
        "initial_order": "order of the published polynomial, and of expected uncertainties",
        "reference_temperature": "where the scale-factor error is stated",
        "asked_uncertainty": "standard uncertainty of the curve that the plan must promise",
        "verification": "the ramp of step 4; none unless given",
        "verification.direction": "of the temperature",
        "verification.ramp_rate": "how fast the chamber's temperature changes",
        "drive": "a recorded drive for the vehicle test; none unless given",
        "drive.file": "its CSV file, by path or by name in `config/drives`; copied into the run",
        "drive.latitude": "where it was, north positive; that of the table unless given",
        "drive.initial_heading": "heading at its start; without it the vehicle is taken to be "
        "level on average",
        "thresholds": "where a flag is raised",
        "thresholds.gap": "in nominal intervals between sets",
        "thresholds.model_too_stiff": "correlation of residuals at neighbouring temperatures",
        "thresholds.outlier": "in standard deviations of a turn",
    },
    "nine-axis-calibration": {
        "latitude": "of the bench, north positive",
        "positions": "the published positions, each once, in the order in which they are taken",
        "positioning": "`plate`: a person turns the sensor over; `table`: the table does",
        "flip": "whether each position is taken once more, turned by 180 deg about the vertical",
        "static_time": "time of the record at rest in each position (first preset time)",
        "range": "where the gyros saturate; every rate must lie below it",
        "rates": "magnitudes of the rates, five or more; each is turned in both senses",
        "dwell": "`equal`: the same time at each rate, as published; `efficient`: the same number "
        "of whole turns, so that the time goes as 1/rate",
        "dwell_time": "time at each rate with an equal dwell (second preset time), whole turns at "
        "every rate; 360 s unless given",
        "turns": "whole turns at each rate with an efficient dwell; 1 unless given",
        "settle": "time at the rate before the record begins",
        "static_settle": "time at rest in a position before its record begins",
        "warm_up": "time between switching on and the first record",
        "sample_rate": "samples a second",
        "table_axis": "the table's axis that turns, counted from 1",
        "angle_random_walk": "expected noise of the gyros, for expected uncertainties",
        "prior": "standard uncertainties of the set-up, known beforehand",
        "prior.heading": "of the plate against north, common to all positions",
        "prior.relative_heading": "of each position beside the others",
        "prior.tilt": "of each position about each horizontal axis",
        "prior.accelerometer_bias": "of each accelerometer",
        "prior.misalignment": "of a gyro's input axis, where the rates did not measure it",
        "prior.mounting": "of the sensor on the table, about each of two axes; as `prior.tilt` "
        "unless given",
        "prior.table_axes": "of the table's axes, leaning and stopping beside their angle",
        "prior.clock": "of the computer's seconds, in which the true rates are",
        "pose": "when a position is refused",
        "pose.acceleration": "an accelerometer's mean is further from gravity than this",
        "pose.rate": "a gyro's mean is further from the other positions' than this",
        "pose.largest_bias": "a gyro's mean is further from earth rate than this, when a position "
        "is judged alone",
        "pose.attempts": "how often a position is measured before it stays refused",
        "thresholds": "where a flag is raised",
        "thresholds.not_significant": "in standard uncertainties of asymmetry and nonlinearity",
        "thresholds.gap": "in nominal sample intervals",
        "thresholds.outlier": "in robust standard deviations of the samples",
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
    **{f"limits.{name}": limit.meaning for name, limit in limits().items()},
}

INSTRUMENT = {
    "driver": "name of the driver; `station list drivers` gives them",
    "address": "VISA resource name, `socket://host:port`, `modbus-tcp://host`, "
    "`socketcand://host:port/channel` or a serial port; another kind is refused, but for the "
    "`scheme://…` of a driver of your own; none on a simulated bench",
    "shares": "instruments over whose lines this one is reached, in place of an address",
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
        "undriven_sensitivity": "largest sensitivity of an axis that was not driven; 3 deg/h/mT "
        "unless given",
    },
    "accelerometer-magnetic-sensitivity": {
        "local_gravity": "gravity at the place; `1 g` where accelerations are to be in local g",
        "mounting": "standard uncertainty of how the input axis lies to the encoder's zero, OA and "
        "PA; where nobody states it, 0.0005 rad (100 arcsec) is assumed; it counts where the rows "
        "do not tell a lean from a coefficient, as in plane `level` or at one field",
    },
    "serf-nonorthogonality": {
        "sample_rate": "of the records; the rows' times must agree",
        "gyromagnetic_ratio": "of the electron",
        "nuclear_spin": "of the alkali: 1.5, 2.5 or 3.5",
        "pump_axis": "the coil along which the pump light passes",
        "probe_axis": "the coil along which the probe light passes",
        "coil_constants": "`known`: commanded fields are exact; `nominal`: each coil has a factor",
        "mains_frequency": "of a pick-up that is fitted; none where null",
        "shots": "one for each column of the file",
        "shots[].id": "name of its column",
        "shots[].field": "commanded field along the coils x, y, z",
    },
    "fog-scale-factor-temperature": {
        "attitude_output": "whether turns have headings alone, or pitch and roll beside them",
        "turn_sense": "what a positive commanded turn is: growing heading, or a positive rotation "
        "about the body axis that points up",
        "heading_resolution": "of the navigator",
        "turntable_accuracy": "of a full turn, for the record",
        "angle_random_walk": "of the gyros, for the record",
        "temperature_range": "that was asked for",
        "soak": "time at the lowest temperature; published 4 h to 6 h",
        "gyro_bias": "specification of the gyros' bias as a standard uncertainty; required where "
        "turns have one sense",
        "initial_order": "order of the published polynomial",
        "reference_temperature": "where the scale-factor error is stated",
        "latitude": "of the drive, north positive; required with a drive",
        "initial_heading": "heading at the start of the drive; without it the vehicle is taken to "
        "be level on the average",
    },
    "nine-axis-calibration": {
        "latitude": "of the bench, north positive",
        "range": "where the gyros saturate; without it saturated samples are known by their values",
        "prior": "standard uncertainties of the set-up, known beforehand",
        "prior.heading": "of the plate against north, common to all positions",
        "prior.relative_heading": "of each position beside the others",
        "prior.tilt": "of each position about each horizontal axis",
        "prior.accelerometer_bias": "of each accelerometer",
        "prior.misalignment": "of a gyro's input axis, where the rates did not measure it",
        "prior.mounting": "of the sensor on the table, about each of two axes; as `prior.tilt` "
        "unless given",
        "prior.table_axes": "of the table's axes, leaning and stopping beside their angle",
    },
}
