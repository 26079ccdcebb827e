"""What the laws do in a plant as it is built, beside the ideal one."""
