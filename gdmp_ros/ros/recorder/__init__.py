"""Node ``take_recorder``, and recording of topics to bags."""
