"""From rows of truth to impacts, figures and reports."""
