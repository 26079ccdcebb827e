"""From measured records to a calibrated scene: observation, least squares, verdicts."""
