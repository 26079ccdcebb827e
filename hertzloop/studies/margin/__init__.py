"""Linear margins of the sampled loop: transfer function, table of arcs, result."""
