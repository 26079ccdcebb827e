"""The plant for programs that have no Python: a C library, and a co-simulation unit (FMU)."""
