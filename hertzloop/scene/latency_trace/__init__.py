"""Latencies by sample (`controller.latency_trace`): from a file of a measurement."""
