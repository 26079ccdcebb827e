"""What is struck: anything linear, given to the plant by its modes."""
