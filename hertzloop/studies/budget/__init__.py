"""How much latency, noise, jitter and how few bits a law tolerates before it misses a goal."""
