"""Whether the automatic choice of a model meets what was asked."""
