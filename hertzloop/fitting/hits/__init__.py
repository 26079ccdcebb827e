"""Hits in measured records: found, judged, and split from each other."""
