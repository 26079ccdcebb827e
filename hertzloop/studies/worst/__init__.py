"""The worst sequence of latencies of a scene, within a range."""
