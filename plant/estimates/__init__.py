"""Estimates made before a run: how many modes it needs, which plate model, neglected effects."""
