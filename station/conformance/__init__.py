"""Tests that a laboratory runs on a driver of its own, before a run trusts it.

    pytest -p station.conformance.plugin --pyargs station.conformance \\
        --station-driver my-supply --station-bench my-bench.yaml

`--station-driver` is the driver's entry point in `station.drivers`; `--station-bench` a bench file,
or the name of one, in which an instrument has this driver (the simulated bench unless given);
`--station-instrument` chooses one where several have it. pytest comes with the extra `test`.

What is asked: every driver has the verbs of its role, says who is there, gives one clear error for
a closed port, for silence and for nonsense, within its deadline, and can be closed twice. What can
harm is energised by nobody who only looks, says so when it is, is brought to rest by its last
attempt, and takes neither silence nor an answer from before for rest. A coil supply takes its
limits, refuses what is beyond them, runs its sine, and comes to rest from any state, no faster than
its slew limit, proven by its own reading back. A sampled source delivers its columns, counts
without a gap for a minute, and is quiet once stopped. A rotary stage takes its limits, turns to no
angle before its zero is found, reads the angle that was commanded, and stops from any movement. A
meter or a thermometer gives each burst of readings once and whole, in exchanges that do not wait
for it. A digitizer brings one whole record about each trigger that it gives, and its trigger output
comes to rest. A shutter proves where it stands, and closes from any state. A thermal chamber takes
its limits, ramps evenly to its set-point, holds, and switches heater and compressor off from any
state. A cell's heater takes its limit, ramps to its set-point, and is off from any state. A supply
of the device under test asks the operator for nothing that it did not declare.

On a simulated bench (one with `simulation`) the instrument's simulator answers, on virtual time,
in the world of `--station-procedure`. On a real bench the tests wait in real time, and whatever
would energise something is left out unless `--station-energise` is given: a quarter of the bench
file's current limit then flows, as a sine of 0.1 Hz. The silent and garbled partners are servers of
the tests' own on the loopback interface, so a line that is neither `TCPIP::…::SOCKET`,
`socketcand://`, `modbus-tcp://` nor `socket://` is not tried with them.

The package is part of `station`, because it reads benches and opens instruments as a run does. It
knows no driver: roles come by the entry points of `station.roles`, a role's Protocol says which
verbs to look for, and its `start_samples` how a source of samples is started.
"""
