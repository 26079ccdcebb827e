"""Force laws, the latency line between law and actuator, force quantisation."""
