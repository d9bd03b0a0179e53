"""What each key of a YAML file means, where the model itself does not say so."""

from __future__ import annotations

from station.roles.role import limits

ROOM = {"temperature": "temperature", "humidity": "relative humidity", "pressure": "air pressure"}
READ = {
    "value": "what was read; left out, the run asks for it",
    "uncertainty": "its standard uncertainty",
    "instrument": "what it is read on",
    "certificate": "the certificate of that",
    "due": "until when that holds",
}
PLAN = {
    "plan": "version of the format",
    "extends": "another plan, by name or path relative to this file, that this one changes",
    "vars": "values that `${name}` stands for",
    "procedure": "name of the procedure; `station list procedures` gives them",
    "title": "heading of the report",
    "operator": "who runs it",
    "check_standard": "whether the device is the bench's own standard, whose results are charted "
    "to watch the bench",
    "released": "whether an operator may start it from the panel; a plan that extends it is not",
    "dut": "the device under test",
    "dut.model": "its model",
    "dut.serial": "its serial number, which also names the run folder",
    "dut.manufacturer": "its maker",
    "dut.received": "the day it arrived, for a certificate",
    "dut.condition": "the condition it arrived in, for a certificate",
    "dut.notes": "anything else, for the report",
    "parameters": "the procedure's own parameters, see below",
    "limits": "result name to `min`, `max` or `max_abs`, for all axes or by axis",
    "decision_rule": "how a result is held against its limit",
    "references": "documents that report and certificate name; `order` and `work_instruction` are "
    "those that a certificate must name",
    "customer": "who ordered the measurement, for a certificate",
    "customer.name": "their name",
    "customer.address": "their address",
    "room": "what a person reads of the room, for a certificate",
    **{
        f"room.{name}": f"its {words}, typed or asked for by the run"
        for name, words in ROOM.items()
    },
    **{f"room.{name}.{key}": words for name in ROOM for key, words in READ.items()},
    "deviations": "what was done otherwise than the method says, a sentence each",
}

PARAMETERS = {
    "commissioning": {
        "checks": "the parts that are walked",
        "supplies": "the part of the coils' supplies, each by itself",
        "supplies.limit": "limit that each supply is given, to be asked for more",
        "supplies.beyond": "how much more than the limit is asked for",
        "supplies.cut_at": "current at which each output is cut off",
        "supplies.record": "length of each record of the field",
        "supplies.settle": "time between a change of the field and its record",
        "supplies.turn_probe": "whether a person turns a probe of one axis along each coil",
        "clocks": "the part of the clocks of instruments that stamp their readings",
        "clocks.record": "length of the record of time stamps",
        "contacts": "the part of the contacts of the chamber's door and of the interlock chain",
        "contacts.door": "whether a person opens and closes the chamber's door",
        "contacts.chain": "contacts of the interlock chain that a person opens and closes",
        "contacts.settle": "time between a hand at a contact and the look at it",
        "coils": "the part of coils, their supplies and the field probe",
        "watch": "figures that are held against those of the bench's commissioning; "
        "`station commission --check` takes those that the bench file holds",
        "coils.field": "steady field of each coil, of either sense",
        "coils.record": "length of each record of the field",
        "coils.settle": "time between a change of the field and its record",
        "coils.turn_probe": "whether a person turns a probe of one axis along x, y and z",
        "ambient": "the ambient field along the bench's axes, from a map and a compass; it "
        "decides whether a coil or an axis of the probe is reversed",
        "ambient.x": "component along x",
        "ambient.y": "component along y",
        "ambient.z": "component along z",
        "ambient.standard_uncertainty": "of each component",
        "probe": "the part of the probe's place in the coils, and their homogeneity",
        "probe.field": "steady field of each coil, of either sense",
        "probe.record": "length of each record of the field",
        "probe.settle": "time between a change of the field and its record",
        "probe.device": "edge of the cube, at the centre, in which the homogeneity is reported",
        "probe.placing": "standard uncertainty of each move of the probe by hand",
        "lines": "the part of each instrument's line by itself",
        "lines.instruments": "which instruments are asked; `station commission` takes those of the "
        "bench",
        "lines.queries": "questions for its identity that each is asked",
        "lines.disconnected": "instruments whose cable a person pulls and plugs in again",
        "chamber": "the part of the chamber and of the device's thermometers in it",
        "chamber.from": "temperature at which the air is held before the step",
        "chamber.step": "step of the set-point from there",
        "chamber.before": "how long the air is held before the step",
        "chamber.after": "how long it is held after the step",
        "pick_up": "the part of what the voltmeter takes up of driven coils, the device off",
        "pick_up.frequency": "frequency of the drive",
        "pick_up.field": "amplitude of the drive, as a peak",
        "pick_up.record": "length of each record",
        "pick_up.every": "time between two readings",
        "motion": "the part of the turntable, by the nine-axis sensor on it",
        "motion.device": "what stands on the table; `station commission` takes the navigator where "
        "the bench has no nine-axis sensor",
        "motion.latitude": "of the bench, north positive, for a navigator's alignment",
        "motion.align_at_most": "after this time without alignment the run ends with code 3",
        "motion.small_turn": "angle of the turns that decide the senses",
        "motion.small_rate": "rate of these turns",
        "motion.whole_turns": "whether each axis makes a whole turn there and back",
        "motion.whole_rate": "rate of the whole turns",
        "motion.rest": "length of each record at rest",
        "motion.sample_rate": "outputs of the sensor in a second",
        "motion.placing": "standard uncertainty of the angle at which the sensor stands against "
        "its stops",
        "motion.navigator_level": "standard uncertainty of what a navigator takes for the vertical",
        "motion.gyro_misalignment": "standard uncertainty of a gyro's axis towards another one",
        "motion.gyro_scale": "relative standard uncertainty of its gyros' scale factors",
        "stage": "the part of the rotary stage, by the accelerometer on it",
        "stage.scale_factor": "nominal scale factor of the accelerometer",
        "stage.mounting": "standard uncertainty of the angle at which its axes stand along the "
        "stage's",
        "stage.warm_up": "time between switching it on and the first record",
        "stage.readings": "readings of the voltmeter at each angle",
        "stage.nplc": "integration time of a reading in periods of the mains",
        "gyro": "the part of the laser gyro at rest",
        "gyro.channel": "input of the pulse board",
        "gyro.pulse_weight": "angle of one output pulse",
        "gyro.sample_interval": "interval of the gyro's samples",
        "gyro.warm_up": "time between switching it on and the record",
        "gyro.record": "length of the record at rest",
        "earth": "what of the earth's rate the gyro feels; without it nothing is said of the "
        "pulse weight",
        "earth.latitude": "of the bench, north positive",
        "earth.elevation": "of the input axis over the level",
        "earth.azimuth": "of the input axis, from north over east",
        "earth.direction": "standard uncertainty of its direction",
        "earth.bias": "of the gyro, as a standard uncertainty about zero",
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
        "local_gravity": "gravity at the place; `1 g` where accelerations are to be in local g",
        "local_gravity_uncertainty": "its standard uncertainty; not stated unless given",
        "ambient_field": "field across the coil, of which a probe that leans reads a part; not "
        "stated unless given",
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
        "cell_temperature": "of the cell, to which `cell_heater` brings it in step 1; a person "
        "does, and types it, unless given",
        "heating_rate": "of the ramp to it",
        "stability": "when the cell counts as warm, step 1",
        "stability.within": "how near it is to `cell_temperature`",
        "stability.duration": "for how long it has been so near",
        "stability.at_most": "how long all of that may take; after that the run ends with code 3",
        "gyro_was_running": "whether nuclei are polarised, so that step 1 must be done",
        "depolarise": "step 1",
        "depolarise.gradient": "along z; published 2000 nT/cm",
        "depolarise.duration": "how long it acts before the nuclei are looked for",
        "depolarise.rounds": "how often it acts; after that the run ends with code 3",
        "nulling": "step 2",
        "nulling.method": "how it is found; `nulling: modulation` says this alone",
        "nulling.tone": "amplitude of the tone on each coil in turn, by modulation",
        "nulling.bias": "the field to either side about which a tone swings",
        "nulling.frequency": "frequency of the tone",
        "nulling.cycles": "how many cycles of a tone are demodulated",
        "nulling.light_shift": "at most so much of the field along the pump light is its own",
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
        "drive.latitude_uncertainty": "its standard uncertainty; not stated unless given",
        "drive.initial_heading": "heading at its start; without it the vehicle is taken to be "
        "level on average",
        "drive.initial_pitch": "and pitch; navigation to position and velocity needs all three",
        "drive.initial_roll": "and roll",
        "drive.initial_heading_uncertainty": "its standard uncertainty; not stated unless given",
        "drive.initial_level_uncertainty": "of pitch and roll, each; not stated unless given",
        "drive.accelerometer_bias": "specification of each accelerometer, a standard uncertainty; "
        "not stated unless given",
        "drive.reference": "CSV file of the trajectory that it truly took, likewise; with specific "
        "force in the drive it is navigated to position and velocity",
        "drive.reference_position_uncertainty": "of the reference's positions, each, a standard "
        "uncertainty; not stated unless given",
        "thresholds": "where a flag is raised",
        "thresholds.gap": "in nominal intervals between sets",
        "thresholds.model_too_stiff": "correlation of residuals at neighbouring temperatures",
        "thresholds.outlier": "in standard deviations of a turn",
    },
    "gyro-static-noise": {
        "latitude": "of the bench, north positive",
        "latitude_uncertainty": "its standard uncertainty, which the earth's rate brings into the "
        "bias; not stated unless given",
        "input_axis": "`IA` of one gyro, or `X`, `Y`, `Z`: where each points; a navigator's up or "
        "down, each in turn",
        "input_axis.NAME.azimuth": "clockwise from north",
        "input_axis.NAME.elevation": "above level",
        "attitude_uncertainty": "standard uncertainty of azimuth and of elevation",
        "source": "what gives the output: the pulse board of one gyro (axis IA), the nine-axis "
        "sensor or the navigator (axes X, Y, Z)",
        "sample_interval": "time between two counts of the board, or two outputs",
        "pulse_weight": "angle of one pulse; of a navigator the step of its angles; none of a "
        "sensor, which gives rates",
        "channel": "of the acquisition board",
        "warm_up": "after each switch-on, before the record begins",
        "record": "length of the main record; the rate random walk needs 12 h to 24 h",
        "repeats": "further switch-ons, each with a short record",
        "repeat_record": "length of each of them",
        "cool": "time switched off before each of them",
        "clock": "standard uncertainty of the rate of the station's clock",
        "thresholds": "where flags are raised",
        "thresholds.not_significant": "standard uncertainties of its square below which a "
        "coefficient is noise",
        "thresholds.gap": "longest interval that is no gap, in sample intervals",
        "thresholds.outlier": "robust standard deviations beyond which a sample is left out",
        "thresholds.drift_removed": "standard uncertainties beyond which a ramp is named",
    },
    "accelerometer-tumble": {
        "mountings": "how the accelerometer is mounted, in this order: plane `io` or `ip`, "
        "`-reversed` by 180 deg about its input axis",
        "heads": "places of the fixture on the stage's head, all mountings at each; 90 deg beside "
        "0 deg frees Kiii of the encoder",
        "positions": "in a turn, evenly from 0 deg",
        "up_and_down": "whether the positions are gone through downwards, too",
        "dwell": "time at rest before a position is read",
        "readings": "readings of the voltmeter at each position",
        "nplc": "integration time of a reading in periods of the mains",
        "reading_noise": "expected standard deviation of a reading, for expected uncertainties",
        "scale_factor": "nominal scale factor; the voltmeter's range follows from it",
        "warm_up": "time between switching on and the first position",
        "temperature": "whether the thermometer is read at each position",
        "local_gravity": "gravity where the stage stands",
        "local_gravity_uncertainty": "its standard uncertainty; not stated unless given",
        "encoder_accuracy": "standard uncertainty of each of the encoder's first two harmonics; "
        "what the stage's record says of its `graduation` unless given",
        "mounting_repeatability": "standard uncertainty of the angle of each mounting",
        "thresholds": "where flags are raised",
        "thresholds.not_significant": "standard uncertainties below which a coefficient is noise",
        "thresholds.outlier": "robust standard deviations beyond which a reading is left out",
        "thresholds.model_too_stiff": "lag-1 correlation of the residuals",
        "thresholds.nuisance": "standard deviations of what is stated beyond which an angle of "
        "encoder or mounting is named",
    },
    "gyro-bias-temperature": {
        "latitude": "of the chamber, north positive",
        "latitude_uncertainty": "its standard uncertainty, which the earth's rate brings into the "
        "bias; not stated unless given",
        "input_axis": "where the positive input axis points",
        "input_axis.NAME.azimuth": "clockwise from north",
        "input_axis.NAME.elevation": "above level",
        "attitude_uncertainty": "standard uncertainty of azimuth and of elevation",
        "sample_interval": "time between two counts of the board",
        "row_interval": "over which counts and temperatures are averaged for the analysis",
        "pulse_weight": "angle of one pulse",
        "channel": "of the acquisition board",
        "room_temperature": "of the chamber, where the gyro is switched on and where it comes "
        "back to",
        "warm_up": "after the switch-on, before the record begins",
        "soaks": "temperatures of the chamber in their order",
        "soak": "how long the set-point stands at each",
        "ramp_up": "how fast the set-point rises",
        "ramp_down": "how fast it falls",
        "chamber_interval": "time between two readings of the chamber",
        "soaked_within": "how near its set-point the chamber's air is at the end of a soak",
        "chamber_at_most": "longest time in which the chamber comes to room temperature",
        "reference_temperature": "temperature of the gyro at which the bias is reported",
        "sensor_lag_prior": "standard uncertainty, known beforehand, of how far the gyro's "
        "thermometer runs ahead of what its bias follows",
        "thermometer_uncertainty": "standard uncertainty of the thermometer's offset; not stated "
        "unless given",
        "clock": "standard uncertainty of the rate of the station's clock",
        "thresholds": "where flags are raised",
        "thresholds.not_significant": "standard uncertainties below which rate sensitivity and "
        "hysteresis are noise",
        "thresholds.gap": "longest interval that is no gap, in row intervals",
        "thresholds.outlier": "robust standard deviations beyond which a row is left out",
        "thresholds.model_too_stiff": "correlation of neighbouring residuals",
    },
    "gyro-rate-table": {
        "latitude": "of the bench, north positive",
        "latitude_uncertainty": "its standard uncertainty, which the earth's rate brings into the "
        "bias; not stated unless given",
        "rates": "each in both senses, two or more; seven are usual",
        "range": "of the gyro, full scale of `nonlinearity_of_full_scale`; else the largest rate",
        "record": "least length of a record; as many whole turns as take it",
        "stand": "the table standing, before and after the turns",
        "settle": "time at the rate before a record begins",
        "switch_ons": "how often the gyro is switched on, with all records each time",
        "warm_up": "after each switch-on, before the records begin",
        "cool": "time switched off before each further one",
        "source": "what gives the output: the pulse board of one gyro (axis IA), the nine-axis "
        "sensor or the navigator (axes X, Y, Z)",
        "axes": "each mounted up in turn; `IA` of a pulse board",
        "clock": "standard uncertainty of the rate of the station's clock, for a sensor's rates",
        "sample_interval": "time between two counts of the board, or two outputs",
        "reading_interval": "time between two readings of the table's encoder",
        "pulse_weight": "nominal angle of one pulse, which the scale factor is relative to; of a "
        "navigator the step of its angles; none of a sensor, which gives rates",
        "channel": "of the acquisition board",
        "levelled_by": "`table`, of three axes, or `person`",
        "table_axis": "number of the vertical axis where the bench file names none",
        "alignment": "uncertainty of the input axis along the table's; 1 - cos of it is in u of K",
        "level": "standard uncertainty of the table's axis to the vertical",
        "angle_random_walk": "of the gyro, for what `validate` says of the uncertainty",
        "thresholds": "where flags are raised",
        "thresholds.not_significant": "standard uncertainties below which an asymmetry is noise",
        "thresholds.gap": "longest interval that is no gap, in sample intervals",
        "thresholds.outlier": "robust standard deviations beyond which a sample is left out",
        "thresholds.drift_removed": "standard uncertainties beyond which a ramp is named",
    },
    "nine-axis-calibration": {
        "latitude": "of the bench, north positive",
        "latitude_uncertainty": "its standard uncertainty, which the earth's rate brings into the "
        "bias; not stated unless given",
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
        "poses": "further directions that point up, at rest: faces such as `-X`, edges such as "
        "`X+Y`, corners such as `-X-Y-Z`; for accelerometers and magnetometer",
        "pose_time": "time of the record in each of `poses`",
        "turned_down": "axes that are also turned pointing down; for the gyros' g-sensitivity",
        "turned_down_rates": "magnitudes of the rates of `turned_down`, in both senses",
        "local_gravity": "gravity where the sensor is, in the unit of the accelerometers",
        "earth_field": "the earth's field where the sensor is, by a model or another instrument; "
        "without it the magnetometer's scale factors are relative to each other",
        "earth_field.magnitude": "its magnitude",
        "earth_field.inclination": "its angle below the horizon",
        "magnetometer_in_coil": "the sensor in the three-axis coil at the end, the gaussmeter's "
        "probe beside it; without it no coil is driven",
        "magnetometer_in_coil.levels": "fields of each coil, of either sense; zero comes with them",
        "magnetometer_in_coil.record": "length of each record",
        "magnetometer_in_coil.settle": "time between a change of the field and its record",
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
        "prior.edge": "of a direction between axes in `poses`: of the wedge, or of the table",
        "prior.local_gravity": "of `local_gravity`",
        "prior.earth_field_magnitude": "of `earth_field.magnitude`",
        "prior.earth_field_inclination": "of `earth_field.inclination`",
        "prior.accelerometer_second_order": "of the accelerometers' second order, where the poses "
        "do not determine it; 0 takes it as none",
        "prior.gaussmeter_gain": "of the gaussmeter's gain; 0 takes that of its calibration record",
        "prior.gaussmeter_zero": "of each axis of its probe; 0 takes that of its record",
        "prior.coil_alignment": "of the sensor's axes to the probe's",
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
    "calibration.calibrated_by": "the laboratory that made it",
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
    "`socketcand://host:port/channel`, `can://INTERFACE/CHANNEL` or a serial port; another kind is "
    "refused, but for the `scheme://…` of a driver of your own; none on a simulated bench",
    "shares": "instruments over whose lines this one is reached, in place of an address",
    "serial": "the serial number that must answer; without it any does",
    "deadline": "run time that every exchange may take, where that is longer than the driver "
    "states; see [Deadlines](#deadlines)",
    "settings": "the driver's own settings, see below",
    "simulator": "the truth about the simulated instrument, and a fixed `port` where wished",
    **LIMITS,
    **CALIBRATION,
}

COIL_SYSTEM = {
    "pairs": "its Helmholtz pairs, by the axis that each stands along",
    "pairs.NAME.radius": "mean radius of its windings",
    "pairs.NAME.radius_uncertainty": "standard uncertainty of that",
    "pairs.NAME.spacing": "distance between the middles of its windings",
    "pairs.NAME.spacing_uncertainty": "standard uncertainty of that",
    "probe": "where the sensitive spot of the gaussmeter's probe is in a run",
    "device": "where the middle of the device is, and its size",
    **{
        f"{what}.{axis}": f"from the centre of the coils, towards +{axis}"
        for what in ("probe", "device")
        for axis in "xyz"
    },
    **{
        f"{what}.uncertainty": "standard uncertainty of each coordinate"
        for what in ("probe", "device")
    },
    "device.box": "its size as a box, or",
    **{f"device.box.{axis}": f"edge along {axis}" for axis in "xyz"},
    "device.sphere": "its diameter as a sphere",
}

BENCH = {
    "bench": "version of the format",
    "name": "name of the bench",
    "title": "heading in reports",
    "laboratory": "who measures, for certificates",
    "laboratory.name": "name of the laboratory",
    "laboratory.address": "its address",
    "laboratory.location": "where the bench stands, where that is not the address",
    "laboratory.country": "its country in two letters, such as `DE` (ISO 3166-1), for a dcc",
    "laboratory.accreditation": "body and number of the accreditation",
    "laboratory.cmc": "smallest U that a certificate may state (CMC), by name of the result",
    "laboratory.si_statement": "how the results are traceable to the SI, as certificates say it",
    "laboratory.trusted_keys": "keys whose signatures count for `station verify --bench`: 64 "
    "digits each, then the name it signs in, or nothing",
    "laboratory.signatories": "who may authorise a certificate",
    "laboratory.signatories[].name": "name of the person",
    "laboratory.signatories[].function": "function of the person",
    "simulation": "truth of the simulated world; its presence makes the bench a simulated one",
    "instruments": "the instruments by instance",
    **{f"instruments.NAME.{key}": text for key, text in INSTRUMENT.items()},
    "interlocks": "conditions on readings under which the bench may not go on",
    "interlocks[].name": "what it is called in messages",
    "interlocks[].when": "a level or a state of a quantity of an instrument, or `any`, `all`, "
    "`not` of such conditions",
    "interlocks[].grace": "for how long the condition may hold",
    "interlocks[].period": "how often it is looked at",
    "notify": "who is informed at a prompt and at the end of a run",
    "notify.command": "a program and its arguments, each in its own place of the list; no shell",
    "coil_geometry": "where coils, probe and device are, for the field at the device by that at "
    "the probe; see [measure where the probe is](../how-to/measure-where-the-probe-is.md)",
    "coil_geometry.three_axis": "the three-axis coil, pairs `x`, `y` and `z`",
    "coil_geometry.dc": "the strong coil, whose only pair `x` has its axis along x of the probe",
    **{
        f"coil_geometry.{coil}.{key}": text
        for coil in ("three_axis", "dc")
        for key, text in COIL_SYSTEM.items()
    },
    "commissioned": "figures of the bench's commissioning, written by it",
    "commissioned.date": "the day of the commissioning",
    "commissioned.run": "its run folder",
    "commissioned.figures": "the figures that a weekly check watches",
    "commissioned.figures[].name": "name of the result",
    "commissioned.figures[].axis": "its axis",
    "commissioned.figures[].value": "what was measured",
    "commissioned.figures[].unit": "its unit",
    "commissioned.confirmed": "forms of instruments that their documents do not decide, as met",
    "commissioned.confirmed[].instrument": "the instrument",
    "commissioned.confirmed[].met": "the form or firmware that it has",
    "commissioned.tried": "questions that no document confirms, and what came of them",
    "commissioned.tried[].instrument": "the instrument",
    "commissioned.tried[].command": "the question as it was sent",
    "commissioned.tried[].answer": "its answer, or its error",
    "commissioned.tried[].confirmed": "whether it was answered, without an error",
    "commissioned.figures[].standard_uncertainty": "of this measurement, in the same unit",
    "safe_state": "the order in which instruments are brought to rest at the end of every run",
    "safe_state[].instrument": "an instance, or",
    "safe_state[].role": "all instances of a role",
    "safe_state[].within": "the time it may take",
}

DATASET = {
    "dataset": "version of the format",
    "procedure": "name of the procedure that analyses it",
    "title": "heading of the report",
    "files": "name to CSV or TDMS file in the same folder",
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
        "local_gravity_uncertainty": "its standard uncertainty; not stated unless given",
        "device_gradient": "how far the farthest place of the device is off the thermometer that "
        "counts, the half-width of a rectangular distribution; not stated unless given",
        "thermometer_uncertainty": "standard uncertainty of the thermometer's offset: of the "
        "temperature that results hold at; not stated unless given",
        "probe_angle": "standard uncertainty of the angle between the gaussmeter's probe and the "
        "coil's axis: 1 - cos of it is in the field; not stated unless given",
        "ambient_field": "component of the ambient field across the coil, which a probe that leans "
        "sees in part; not stated unless given",
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
        "device_gradient": "how far the farthest place of the device is off the thermometer that "
        "counts, the half-width of a rectangular distribution; not stated unless given",
        "thermometer_uncertainty": "standard uncertainty of the thermometer's offset: of the "
        "temperature that results hold at; not stated unless given",
        "latitude": "of the drive, north positive; required with a drive",
        "latitude_uncertainty": "its standard uncertainty, in the drive's headings; not stated "
        "unless given",
        "initial_heading": "heading at the start of the drive; without it the vehicle is taken to "
        "be level on the average",
        "initial_pitch": "and pitch; a drive with specific force and reference needs all three",
        "initial_roll": "and roll",
        "initial_heading_uncertainty": "its standard uncertainty; not stated unless given",
        "initial_level_uncertainty": "of pitch and roll, each; not stated unless given",
        "accelerometer_bias": "specification of each accelerometer in the drive, a standard "
        "uncertainty; not stated unless given",
        "reference_position_uncertainty": "of the reference's positions, each, a standard "
        "uncertainty; not stated unless given",
    },
    "nine-axis-calibration": {
        "latitude": "of the bench, north positive",
        "latitude_uncertainty": "its standard uncertainty, which the earth's rate brings into the "
        "bias; not stated unless given",
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
        "prior.edge": "of a direction between two or three axes",
        "prior.local_gravity": "of `local_gravity`",
        "prior.earth_field_magnitude": "of the field's magnitude",
        "prior.earth_field_inclination": "of the field's inclination",
        "prior.accelerometer_second_order": "of an accelerometer's second order where the "
        "directions do not determine it",
        "prior.gaussmeter_gain": "of the gaussmeter's gain, in the coil",
        "prior.gaussmeter_zero": "of the gaussmeter's zero",
        "prior.coil_alignment": "of the gaussmeter's axes to the sensor's",
        "local_gravity": "gravity at the bench, in what the accelerometers call g",
        "earth_field": "the earth's field where the sensor is",
        "earth_field.magnitude": "its magnitude",
        "earth_field.inclination": "its inclination, positive down",
    },
    "gyro-static-noise": {
        "sample_interval": "of the gyro",
        "timestamp": "which instant of its interval `t_s` means; `t_s` counts from power-on",
        "gyro_output": "whether there are rates, or `counts` of pulses",
        "pulse_weight": "angle of one pulse; required where the output is counts",
        "output_bandwidth": "of the gyro's own filter; frequencies up to a quarter of it count, "
        "and quantisation noise is not seen",
        "latitude": "of the place, north positive",
        "latitude_uncertainty": "its standard uncertainty, which the earth's rate brings into the "
        "bias; not stated unless given",
        "input_axis": "`IA` of one gyro, or `X`, `Y`, `Z` of a triad: where each points",
        "input_axis.NAME.azimuth": "clockwise from north",
        "input_axis.NAME.elevation": "above level",
        "attitude_uncertainty": "standard uncertainty of azimuth and of elevation",
        "warm_up": "after power-on; earlier samples do not count",
    },
    "gyro-bias-temperature": {
        "sample_interval": "time between two rows, over which each is the mean",
        "timestamp": "which part of its interval `t_s` of a row is",
        "latitude": "latitude of the chamber, north positive, for the earth's rate",
        "latitude_uncertainty": "its standard uncertainty, which the earth's rate brings into the "
        "bias; not stated unless given",
        "input_axis": "where each positive input axis points",
        "input_axis.NAME.azimuth": "from north, clockwise seen from above",
        "input_axis.NAME.elevation": "above the horizon",
        "attitude_uncertainty": "standard uncertainty of both angles; 0 unless given",
        "reference_temperature": "temperature of the gyro at which the bias is reported",
        "device_gradient": "how far the farthest place of the device is off the thermometer that "
        "counts, the half-width of a rectangular distribution; not stated unless given",
        "thermometer_uncertainty": "standard uncertainty of the thermometer's offset: of the "
        "temperature that results hold at; not stated unless given",
        "sensor_lag_prior": "standard uncertainty, known beforehand, of how far the gyro's "
        "own thermometer runs ahead of what its bias follows; not of a chamber's thermometer",
    },
    "accelerometer-tumble": {
        "local_gravity": "gravity where the stage stands",
        "local_gravity_uncertainty": "its standard uncertainty; not stated unless given",
        "device_gradient": "how far the farthest place of the device is off the thermometer that "
        "counts, the half-width of a rectangular distribution; not stated unless given",
        "thermometer_uncertainty": "standard uncertainty of the thermometer's offset: of the "
        "temperature that results hold at; not stated unless given",
        "encoder_accuracy": "standard uncertainty of each of the encoder's first two harmonics",
        "mounting_repeatability": "standard uncertainty of the angle of each mounting",
        "multimeter_gain": "standard uncertainty of the multimeter's gain; 0 unless given",
        "multimeter_zero": "standard uncertainty of its zero; 0 unless given",
    },
    "gyro-rate-table": {
        "sample_interval": "of the gyro",
        "timestamp": "which instant of its interval `t_s` means; the encoder is read at `t_s`",
        "gyro_output": "whether there are rates, or `counts` of pulses",
        "pulse_weight": "angle of one pulse; required where the output is counts",
        "latitude": "of the place, north positive",
        "latitude_uncertainty": "its standard uncertainty, which the earth's rate brings into the "
        "bias; not stated unless given",
        "clock": "standard uncertainty of the rate of the clock of `t_s`, for an output of rates",
        "alignment": "uncertainty of the input axis along the table's; 1 - cos of it is in u of K",
        "level": "standard uncertainty of the table's axis to the vertical",
        "range": "of the gyro, full scale of `nonlinearity_of_full_scale`; else the largest rate",
        "encoder_accuracy": "standard deviation of the encoder's error within a turn",
    },
}
