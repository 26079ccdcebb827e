"""Time-stepping schemes, each a plant beside its kernels; `registry` lists them."""
