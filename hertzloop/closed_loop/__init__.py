"""The compiled closed loop: one for a sweep, for processes, and for a plant alone."""
