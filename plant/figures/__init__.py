"""Figures of impacts: what happened, and how loud it is."""
