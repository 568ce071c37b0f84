"""Gradients of functions of a coupled run, by a second run of the same coupler."""
