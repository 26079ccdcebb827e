"""Many cases of a scene: design, evaluation, journal, checks."""
