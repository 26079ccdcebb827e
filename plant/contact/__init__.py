"""Contact of sphere and structure: Hertz, its damping, and the scalar solve of a step."""
