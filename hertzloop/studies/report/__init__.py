"""The study `report`: a run as a page."""
