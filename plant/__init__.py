"""A structure and a falling sphere: modes, contact, time steps, balance of energy and momentum."""
