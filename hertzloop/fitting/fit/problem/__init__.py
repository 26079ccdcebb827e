"""The least-squares problem: parameters, priors, residuals and their derivatives."""
