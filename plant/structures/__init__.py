"""Structures: anything linear, given to the plant by its modes."""
