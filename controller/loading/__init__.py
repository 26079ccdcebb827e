"""The door for laws: found by name or file, loaded, compiled, or taken from a C library."""
