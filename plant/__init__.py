"""The struck plate: modes, Hertz contact, time-stepping, books of energy and momentum."""
