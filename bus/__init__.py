"""Message types and ports: what crosses between plant, controller and recorder."""

LEAVING = "leaving the bus"  # name of a thread that waits for a peer that hangs
