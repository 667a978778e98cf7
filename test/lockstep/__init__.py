"""Nodes and clients of one process in lockstep: a clock that is stepped, messages in memory."""
