"""A run as one page that needs nothing else: figures, charts, animation, sound, scene."""
