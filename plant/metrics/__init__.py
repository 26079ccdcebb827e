"""Metrics of impacts: times, speeds, forces and noise."""
