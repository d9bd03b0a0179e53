"""Campaigns that tests and benchmarks share; they differ in length alone.

Each yields its cases by one function and judges a case by another.
"""
