"""Records made ready for a fit: samples, noise, the place of the impact, discrepancy."""
