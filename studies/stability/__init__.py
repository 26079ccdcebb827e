"""Where schemes, and the closed loop, fail."""
