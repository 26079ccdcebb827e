"""Readers of file formats: each returns what a file holds, as series with names, units and times.

A reader chooses nothing and converts no unit of a value. Numbers in text are read by
`hertzloop.fitting.records.text`, all other formats by their libraries.
"""
