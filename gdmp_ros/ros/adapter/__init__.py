"""Node ``adapter``: references for other controllers."""
