"""Recordings: MCAP writer, reader, recovery and comparison; replay in Rerun."""
