"""What the models of a plate are worth: the modes left out, and thickness."""
