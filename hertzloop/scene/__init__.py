"""From a scene (TOML) to a Setup, which holds all that a run is made of; the shipped scenes."""
