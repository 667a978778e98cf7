"""The demonstration ``gdmp demo``: both nodes as processes, recorded and reported."""
