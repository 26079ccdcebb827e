"""Scene keys that a fit varies, and what a key changes."""
