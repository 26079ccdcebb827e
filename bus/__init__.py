"""Message types and ports: what crosses between plant, controller and recorder."""
