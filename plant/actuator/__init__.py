"""The actuator between command and structure: its response, its limit, its moving mass."""
