"""Scenes: tables of keys, what does not fit together, reading and writing; the shipped ones."""
