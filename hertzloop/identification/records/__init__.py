"""Files of measurements as samples with units."""
