"""Time of a fine step of the four-dof example: recorded, not recorded, and in plain NumPy."""

import sys
from pathlib import Path

import numpy as np
from timing import in_turn, run

import pmalpha as pm

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
import reference  # noqa: E402

SS, DT = 20, 1.0 / 40.0 / 0.47


def reference_subdomains(model):
    """The same subdomains for the plain NumPy reference."""
    subdomains = []
    for s in model.subdomains:
        scheme = s.scheme
        subdomains.append(
            reference.Subdomain(
                np.diag(s.M),
                s.K if s.K.ndim == 2 else np.diag(s.K),
                am=scheme.am,
                af=scheme.af,
                beta=scheme.beta,
                gamma=scheme.gamma,
                explicit=scheme.explicit,
                substeps=s.substeps,
                double=not scheme.explicit,
                u0=s.u0,
            )
        )
    return subdomains, [model.constraints.matrices[s].toarray() for s in model.subdomains]


def rows(quick):
    steps, few, seconds = (10, 1, 0.0) if quick else (5000, 20, 4.0)
    model = pm.models.four_dof(rho=0.5)
    subdomains, L = reference_subdomains(model)
    coupler = model.coupler(DT, coupling="pm")
    recorded, stepped, plain = in_turn(
        lambda: coupler.run(steps=steps),
        lambda: coupler.step(steps),
        lambda: reference.run(subdomains, L, DT, few),
        seconds=seconds,
    )
    us = 1e6 / SS
    found = [
        {"what": "run, all recorded", "us a fine step": recorded / steps * us},
        {"what": "step, not recorded", "us a fine step": stepped / steps * us},
        {"what": "tests/reference.py", "us a fine step": plain / few * us},
    ]
    for row in found:
        row["over run"] = row["us a fine step"] / found[0]["us a fine step"]
    return found


if __name__ == "__main__":
    run("fine_step", rows, about=__doc__)
