"""Figures of impacts: times, speeds, forces and noise."""
