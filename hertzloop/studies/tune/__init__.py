"""The study `tune`: the settings of laws with the best metrics."""
