"""Advance a coupled problem and keep its results."""
