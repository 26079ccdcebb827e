"""Schemes of one's own, by the interface that anybody has (`hertzloop.plant.schemes.registry`)."""
