"""What all parts share: the decorator of kernels, files written whole, text from outside."""
