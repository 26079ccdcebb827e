"""The closed loop: in one compiled call, through a port in one process, as processes."""
