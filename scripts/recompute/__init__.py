"""Computes a report's tables again, with the Python standard library alone and no code of cpp-rl."""
