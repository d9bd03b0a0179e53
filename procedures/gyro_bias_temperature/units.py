"""The results and their units, in the order of the contract."""

AXES = ("IA", "X", "Y", "Z")
UNITS = {
    "bias": "deg/h",
    "bias_temperature_sensitivity": "deg/h/degC",
    "largest_bias_slope": "deg/h/degC",
    "bias_rate_sensitivity": "deg/h/(degC/min)",
    "hysteresis": "deg/h",
    "sensor_lag": "s",
    "chamber_lag": "s",
}
