"""How much latency and how few bits a law survives."""
