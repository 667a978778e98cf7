"""Small tools without knowledge of robots: files, processes, terminal, optional imports."""
