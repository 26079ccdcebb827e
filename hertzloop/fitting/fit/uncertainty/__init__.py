"""What the records know of the keys: covariance, intervals, what to measure next."""
