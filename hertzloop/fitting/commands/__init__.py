"""The commands `fit` and `scene modes`."""
