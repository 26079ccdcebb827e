"""Which theory and which effects matter, over radius and thickness."""
