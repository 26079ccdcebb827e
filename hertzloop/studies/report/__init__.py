"""The study `report`: a run as a page, and the page of the results of other studies."""
