"""Node ``visualizer``: markers for RViz and Foxglove."""
