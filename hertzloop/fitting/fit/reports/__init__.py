"""A fit as text, JSON, picture and scene."""
