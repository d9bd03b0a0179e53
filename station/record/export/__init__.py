"""The raw data of a run for other tools: HDF5, CSV and MATLAB files made from the record."""
