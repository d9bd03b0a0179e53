"""Estimators that several procedures share: pure functions of NumPy arrays."""
