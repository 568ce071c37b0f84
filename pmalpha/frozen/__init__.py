"""Couplers without Python: the file of a model, and what its inputs and outputs are."""
