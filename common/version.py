"""The version of hertzloop. The package, its messages and its files state it from here."""

__version__ = "0.4.0"
