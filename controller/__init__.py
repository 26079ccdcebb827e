"""Force laws, the signal path between law and actuator, force quantisation."""
