"""A recording's samples for other tools: tables, array files, one MCAP message a sample."""
