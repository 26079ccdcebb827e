"""A fit as text, JSON, page, replay and scene."""
