"""Cases of a scene for all studies: which ones, their simulation, workers, journal."""
