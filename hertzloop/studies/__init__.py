"""Studies of many cases of the whole loop, each in a room of its own."""
