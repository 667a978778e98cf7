"""Node ``trajectory_server``: streams skills as references."""
