"""Measured records: read from files, or made from arrays, with what is known of the measurement.

`files.py` reads the columns of a file, `measurement.py` checks its `[record]` table, and
`reading.py` makes records of both.
"""
