"""The study `sweep`: metrics of a scene over ranges of its keys."""
