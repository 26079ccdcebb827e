"""Whether the class of models fits the records, and what a fit leaves of them."""
