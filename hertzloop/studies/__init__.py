"""Studies with the whole loop: measured baselines, charts, sweeps, published tables."""
