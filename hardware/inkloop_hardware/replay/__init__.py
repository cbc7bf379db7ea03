"""Replay of recorded traffic as a bench."""
