"""Files that the real programs write and read, each in an environment of its own."""
