"""A problem twice: with functions, which `run` evaluates, and with inputs of a frozen model in
their place, to which a loop gives the values that the functions return.

Forces on dofs, specimens, also behind a compensator, and velocities of rows that hold a dof.
"""

import numpy as np
from c_models import OK

import pmalpha as pm
from pmalpha import rig


class Inputs:
    """Inputs of a random problem, by name, and the functions that they replace.

    done: macro steps before the model is frozen, in which inputs add nothing.
    """

    def __init__(self, problem, rng, done):
        self.problem, self.compensated = problem, bool(rng.random() < 0.3)
        dt = problem.couple().dt
        self.begin, self.ports, self.functions, self.specimens = done * dt, {}, {}, {}
        for s, part in zip(problem.space["parts"], problem.sketch.parts):
            if part.head != "pm.Subdomain" or part.tied:
                continue  # of a structure or reduced: not made by `change`
            dof = int(rng.integers(s.n))
            if rng.random() < 0.6:
                wave = Wave(rng.normal(), rng.normal() / dt, rng.normal(), self.begin, done == 0)
                self.functions[f"w_{s.name}"] = wave
                self.ports[f"w_{s.name}"] = ("force", s.name, dof, wave(0.0))
            if rng.random() < 0.3 and done == 0 and dof not in s.massless:
                self.specimens[f"r_{s.name}"] = rng.uniform(0.1, 1.0, 3).round(3)
                self.ports[f"r_{s.name}"] = ("specimen", s.name, dof)
        for row in self._held_rows() if rng.random() < 0.7 else ():
            # no input begins with a slope
            self.functions[f"g_{row}"] = Wave(0.2, 0.3 / dt, 0.0, self.begin + 0.3 * dt, False)
            self.ports[f"g_{row}"] = ("velocity", row)

    def _held_rows(self):
        row = 0
        for tie in self.problem.space["ties"]:
            if isinstance(tie, pm.Constraint):
                if tie.p == len(tie.matrices) == 1 and tie.velocity is None:
                    yield row
                row += tie.p

    def coupler(self, outside):
        """With inputs, or with the functions."""

        def change(given):
            name, n, more = given["name"], np.shape(given["M"])[0], {}
            if f"w_{name}" in self.ports and not outside:
                load = Column(n, self.ports[f"w_{name}"][2], self.functions[f"w_{name}"])
                more["force"] = [*listed(given.get("force")), load]
            if f"r_{name}" in self.ports:
                port = self.ports[f"r_{name}"]
                inner = rig.External([port[2]]) if outside else self._specimen(f"r_{name}", n)
                inner = rig.Compensated(inner, 0.02) if self.compensated else inner
                more["restoring"] = [*listed(given.get("restoring")), inner]
            return given | more

        return self.problem.couple(change, tied=None if outside else self._moved)

    def _moved(self, ties):
        """The constraints with velocities that are functions."""
        row, moved = 0, []
        for tie in ties:
            wave = self.functions.get(f"g_{row}") if isinstance(tie, pm.Constraint) else None
            row += tie.p if isinstance(tie, pm.Constraint) else 0
            moved.append(pm.Constraint(tie.matrices, lambda t, g=wave: [g(t)]) if wave else tie)
        return moved

    def _specimen(self, name, n):
        dof = self.ports[name][2]

        def restoring(t, u, v):
            force = np.zeros(n)
            force[dof] = self._force(name, u[dof], v[dof])
            if t == 0.0:  # what the input begins with
                self.ports[name] = (*self.ports[name][:3], float(force[dof]))
            return force

        return restoring

    def _force(self, name, u, v):
        k, k3, c = self.specimens[name]
        return float(k * u + k3 * u**3 + 0.1 * c * v)

    def set(self, model, level):
        """The values that count next, each at the time ``level(lead)`` at which it acts."""
        for i, name in enumerate(self.ports):
            if name in self.specimens:
                value = self._force(name, *model.command_of(i)[1][:2])
            else:
                value = self.functions[name](level(model.lead(i)))
            assert model.set(i, value) == OK, model.why


def listed(forces):
    """An argument of `Subdomain` that may be a list, as one."""
    return [] if forces is None else forces if isinstance(forces, list) else [forces]


class Wave:
    """A sine from a time on, which is zero up to it, or has there its first value."""

    def __init__(self, size, rate, phase, begin, jumps):
        self.numbers, self.begin, self.jumps = (size, rate, phase), begin, jumps

    def __call__(self, t):
        size, rate, phase = self.numbers
        if t <= self.begin and not self.jumps:
            return 0.0
        return float(size * np.sin(rate * (t - self.begin) + phase))


class Column:
    """A force of one dof as a function of time."""

    def __init__(self, n, dof, function):
        self.n, self.dof, self.function = n, dof, function

    def __call__(self, t):
        force = np.zeros(self.n)
        force[self.dof] = self.function(t)
        return force
