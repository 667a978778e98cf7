"""Exchange of files with other programs, each in its own virtual environment."""
