"""The study `bench`: how fast a scene runs on this machine."""
