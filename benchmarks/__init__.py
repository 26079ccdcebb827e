"""What a step, an exchange and the loop cost, and could cost."""
