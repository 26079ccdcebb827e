"""From measured data to a scene: records, modes, fits. The rest of hertzloop does not import it."""
