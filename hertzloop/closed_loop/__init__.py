"""The compiled kernels of the closed loop. The Python that calls them is in hertzloop.loop."""
