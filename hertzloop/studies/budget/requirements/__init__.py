"""Requirements on a law in a file beside it: read and checked."""
