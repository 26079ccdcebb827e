"""Data acquisition: filter, sampling, noise, range and quantisation of one quantity."""
