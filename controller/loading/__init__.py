"""The law loader: find a law by name or file, load it, compile it, or load it from a C library."""
