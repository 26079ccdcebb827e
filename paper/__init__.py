"""The published study: its tables and figures again, and where its numerics fail."""
