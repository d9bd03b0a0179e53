"""Published calibration procedures: parameters, steps, datasets, analysis."""
