"""Plant and controller in Python: they call the kernels of hertzloop.closed_loop and the bus."""
