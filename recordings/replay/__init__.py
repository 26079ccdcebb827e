"""Replay of a recording in Rerun: data, views, viewer, pictures."""
