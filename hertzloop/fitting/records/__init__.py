"""Files of measurements as samples with units.

A new file format is one file in `readers/`, one row in `formats.py`, and one row in the table of
formats of docs/how-to/fit.md. The folder `text/` finds the table in any text, and `readers/text.py`
turns this table into the contents of a file. Then `reading.py` takes the contents of every format:
it chooses the series and converts units.
"""
