"""Requirements on a law in a file beside it: read, checked, written as JUnit XML."""
