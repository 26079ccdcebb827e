"""Solve the problem: minimum, outliers, unknown noise and discrepancy, discrete keys."""
