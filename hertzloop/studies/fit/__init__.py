"""From measured records to a calibrated scene: records, observation, least squares, verdicts."""
