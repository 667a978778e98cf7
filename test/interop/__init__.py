"""Exchange of files with other programs, each in a virtual environment of its own."""
