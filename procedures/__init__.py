"""Published calibration procedures: parameters, steps, datasets, analysis."""

DISTRIBUTION = "inertial-station"
