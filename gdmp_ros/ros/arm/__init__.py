"""Node ``panda_sim``: a simulated arm that follows references."""
