"""Faults planted in datasets of every procedure, and what each must end in.

A module for each procedure: `CLEAN` makes its datasets, `ROWS` are the faults whose flags or
refusals are known, `FAULTS` all that `benchmarks/sabotage.py` plants.
"""
