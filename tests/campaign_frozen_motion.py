"""Random couplers that are frozen: refused by name, or the C library does what `run` does, bitwise.

Subdomains, schemes, couplings, substeps, loads, springs, specimens behind compensators and
prescribed velocities are drawn; inputs take the place of functions, also of those at the start.
"""

import tempfile
from pathlib import Path

import frozen_relations
from c_models import Library
from campaign import arguments, seeds, tried

import pmalpha as pm


def campaign(numbers):
    library = Library(pm.c_library() / "libpmalpha.so")
    with tempfile.TemporaryDirectory() as folder:
        return tried(
            lambda seed, counts: frozen_relations.attempt(seed, counts, Path(folder), library),
            numbers,
        )


if __name__ == "__main__":
    words = arguments(__doc__)
    print(dict(campaign(seeds(words.seed, words.seconds))))
