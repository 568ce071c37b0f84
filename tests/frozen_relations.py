"""Random couplers, of which a frozen model does what `run` does, or which are refused by name.

The same problem is made twice: with functions, which `run` evaluates, and with inputs in their
place, to which a loop gives the values that the functions return. `attempt` compares all outputs,
bitwise.
"""

import warnings

import numpy as np
import scipy.sparse as sp
from c_models import OK
from frozen_couplers import all_outputs, held

import pmalpha as pm
from pmalpha import rig

COUPLINGS = ("gc", "pm", "macro", "mean")
SUBSTEPS = {"gc": (1, 2, 3, 6), "pm": (1, 2, 4), "macro": (1, 2, 3), "mean": (1, 2, 3)}
STEPS = 7
# What a refusal has to have: the name of the subdomain, of the input, or of the constraint.
NAMED = ("'s0'", "'s1'", "'s2'", "constraint", "contacts", "'w0'", "'w1'", "'g0'")


class Drawn:
    """One problem of a seed; `coupler(frozen)` makes it with functions or with inputs."""

    def __init__(self, seed):
        self.rng = rng = np.random.default_rng(seed)
        self.coupling = COUPLINGS[rng.integers(4)]
        self.dt = float(rng.choice([0.01, 0.02, 0.03]))
        self.count = int(rng.choice([1, 2, 2, 2, 3]))
        self.inputs = {}
        self.functions = {}  # by name of an input, of t
        self.specimens = {}  # by name, (spring, cubic, damper) of a dof
        self.first = {}  # by name, its force at the start
        # macro steps before it is frozen, in which inputs add nothing
        self.before = int(rng.choice([0, 0, 0, 2]))
        self.parts = [self._subdomain(i) for i in range(self.count)]
        self.constraints = self._constraints()

    # ---- what is drawn ---------------------------------------------------------------------------

    def _subdomain(self, i):
        rng, coupling = self.rng, self.coupling
        n = int(rng.choice([1, 2, 3, 4, 40], p=[0.25, 0.25, 0.25, 0.22, 0.03]))
        k = 100.0 * (1.0 + rng.random(n + 1))
        K = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
        part = {
            "n": n,
            "M": 1.0 + rng.random(n),
            "K": sp.csr_array(K) if rng.random() < 0.3 else K,
            "C": None if rng.random() < 0.5 else 0.002 * K,
            "substeps": int(rng.choice(SUBSTEPS[coupling])) if self.count > 1 else 1,
            "u0": np.zeros(n),
            "v0": np.round(rng.standard_normal(n), 3),
            "loads": self._loads(n),
            "function": None,
            "lagged": rng.random() < 0.1,
            "options": {},
            "springs": self._springs(n),
            "device": int(rng.integers(4)),
        }
        explicit = rng.random() < (0.3 if coupling in ("gc", "pm") else 0.1)
        part["scheme"] = self._scheme(explicit)
        part["internal"] = not explicit and rng.random() < 0.15
        if rng.random() < 0.15:
            part["options"]["double_step"] = bool(rng.random() < 0.5)
        if rng.random() < 0.1:
            part["options"]["limits"] = rig.Limits(displacement=1e6, force=1e12)
        self._add_inputs(i, part)
        return part

    def _scheme(self, explicit):
        rho = 1.0 if self.coupling == "mean" else float(self.rng.choice([0.5, 0.8, 1.0]))
        if explicit:
            return pm.GeneralizedAlpha(rho, explicit=True)
        kinds = [pm.GeneralizedAlpha(rho), pm.Newmark(), pm.HHT(0.1), pm.WBZ(0.1)]
        return kinds[self.rng.integers(len(kinds))]

    def _loads(self, n):
        rng, loads = self.rng, []
        if rng.random() < 0.3:
            loads.append(np.round(rng.standard_normal(n), 2))
        if rng.random() < 0.4:
            samples, average = rng.standard_normal((30, 1)), bool(rng.random() < 0.3)
            loads.append(pm.SampledForce(samples, 0.013, rng.standard_normal(n), average=average))
        if rng.random() < 0.2:
            loads.append(pm.BaseAcceleration(rng.standard_normal(25), dt=0.011))
        return loads

    def _springs(self, n):
        rng = self.rng
        if self.coupling == "mean" or rng.random() < 0.6:
            return []
        dof = int(rng.integers(n))
        kinds = [
            pm.Bilinear(dof, k=40.0, fy=0.5, hardening=0.1),
            pm.CubicSpring(dof, k=10.0, k3=50.0),
            pm.Gap(dof, k=300.0, gap=0.01),
            pm.BoucWen(dof, k=50.0, fy=0.4),
        ]
        return [kinds[rng.integers(len(kinds))]]

    def _add_inputs(self, i, part):
        rng, n = self.rng, part["n"]
        if rng.random() < 0.5:
            for dof in rng.choice(n, size=int(rng.integers(1, min(n, 2) + 1)), replace=False):
                self._add_force(i, int(dof))
        if rng.random() < 0.3 and n < 5 and self.before == 0:
            dofs = rng.choice(n, size=int(rng.integers(1, n + 1)), replace=False)
            part["specimen"] = sorted(map(int, dofs))
            for dof in part["specimen"]:
                name = f"r{i}.d{dof}"
                numbers = np.round(60.0 * rng.random(3) * [1.0, 2.0, 0.01], 3)
                self.specimens[name] = numbers
                self.inputs[name] = ("specimen", f"s{i}", dof)
        if rng.random() < 0.06:
            part["function"] = ("force", "restoring", "motion")[rng.integers(3)]

    def _add_force(self, i, dof):
        w, a, phase = np.round([3.0 + 20.0 * self.rng.random(), 5.0 * self.rng.random(), 1.0], 3)
        phase *= float(self.rng.integers(2))  # 0: it begins with zero
        name = f"w{i}.d{dof}"
        begin = self.before * self.dt
        self.functions[name] = lambda t: (
            float(a * np.sin(w * t + phase)) if t > begin or begin == 0.0 else 0.0
        )
        self.inputs[name] = ("force", f"s{i}", dof, self.functions[name](0.0))

    def _constraints(self):
        rng, constraints = self.rng, []
        for i in range(self.count - 1):
            a, b = int(rng.integers(self.parts[i]["n"])), int(rng.integers(self.parts[i + 1]["n"]))
            self.parts[i + 1]["v0"][b] = self.parts[i]["v0"][a]
            constraints.append(("tie", i, a, b))
        if rng.random() < 0.35:
            i = int(rng.integers(self.count))
            free = self._free_dofs(i, constraints)
            if free:
                constraints.append(self._velocity(i, free))
        return constraints

    def _free_dofs(self, i, constraints):
        tied = {x[2] for x in constraints if x[1] == i} | {
            x[3] for x in constraints if x[1] == i - 1
        }
        return sorted(set(range(self.parts[i]["n"])) - tied)

    def _velocity(self, i, free):
        """Rows of a prescribed velocity: none, or samples, and perhaps an input on one of them."""
        rng = self.rng
        dofs = free[: int(rng.integers(1, 3))]
        for dof in dofs:
            self.parts[i]["v0"][dof] = 0.0
        samples = None
        if rng.random() < 0.5:
            samples = 0.3 * rng.standard_normal((20, len(dofs)))
            samples[:3] = 0.0
        row = None
        if rng.random() < 0.7:
            k = int(rng.integers(len(dofs)))
            row = len(self.parts) - 1 + k
            begin = (self.before + 0.3) * self.dt  # its slope at t = 0 is zero, which no input has
            self.functions["g0"] = lambda t: 0.2 * np.sin(9.0 * max(0.0, t - begin))
            self.inputs["g0"] = ("velocity", row)
        return ("velocity", i, dofs, samples, row)

    def start_specimens(self, plain):
        """Their values at the start are those of the functions there, behind compensators too."""
        plain.state(0)
        for name, value in self.first.items():
            self.inputs[name] = (*self.inputs[name][:3], value)

    # ---- couplers --------------------------------------------------------------------------------

    def coupler(self, frozen):
        subdomains = [self._made(i, part, frozen) for i, part in enumerate(self.parts)]
        constraints = [self._tied(x, subdomains, frozen) for x in self.constraints]
        coupling = {"coupling": self.coupling} if self.count > 1 else {}
        return pm.Coupler(subdomains, constraints, dt=self.dt, **coupling)

    def _made(self, i, part, frozen):
        forces = list(part["loads"])
        names = [x for x, port in self.inputs.items() if port[:2] == ("force", f"s{i}")]
        if not frozen and names:
            forces.append(self._force(names, part["n"]))
        if part["function"] == "force":
            forces.append(lambda t: np.full(part["n"], np.sin(t)))
        if part["function"] == "motion":
            forces.append(MOTION)
        restoring = [] if part["internal"] else list(part["springs"])
        if "specimen" in part:
            restoring.append(self._specimen(i, part, frozen))
        if part["function"] == "restoring":
            restoring.append(RESTORING)
        options = dict(part["options"])
        if not restoring:
            options.pop("limits", None)
        if "specimen" in part or part["function"] == "restoring":
            options["restoring_stiffness"] = 80.0 * np.ones(part["n"])
        return pm.Subdomain(
            part["M"],
            part["K"],
            C=part["C"],
            scheme=part["scheme"],
            substeps=part["substeps"],
            force=forces or None,
            restoring=restoring or None,
            internal=part["springs"] if part["internal"] and part["springs"] else None,
            damping="lagged" if part["lagged"] else "implicit",
            u0=part["u0"],
            v0=part["v0"],
            name=f"s{i}",
            **options,
        )

    def _force(self, names, n):
        def force(t):
            values = np.zeros(n)
            for name in names:
                values[self.inputs[name][2]] += self.functions[name](t)
            return values

        return force

    def _specimen(self, i, part, frozen):
        dofs = part["specimen"]
        numbers = [self.specimens[f"r{i}.d{dof}"] for dof in dofs]

        def restoring(t, u, v):
            r = np.zeros(part["n"])
            for dof, x in zip(dofs, numbers):
                r[dof] = force_of(x, u[dof], v[dof])
                if t == 0.0:
                    self.first[f"r{i}.d{dof}"] = float(r[dof])
            return r

        inner = rig.External(dofs) if frozen else restoring
        if part["device"] == 0:
            return rig.Compensated(inner, self.dt / part["substeps"])
        return inner

    def _tied(self, x, subdomains, frozen):
        if x[0] == "tie":
            _, i, a, b = x
            return pm.tie(subdomains[i], [a], subdomains[i + 1], [b])
        _, i, dofs, samples, row = x
        L = np.zeros((len(dofs), subdomains[i].n))
        L[np.arange(len(dofs)), dofs] = 2.0  # a multiple of a constraint is the same one
        velocity = None if samples is None else pm.SampledForce(2.0 * samples, 0.017)
        if not frozen and row is not None:
            velocity = self._moving(velocity, row - (len(subdomains) - 1), len(dofs))
        return pm.Constraint({subdomains[i]: L}, velocity=velocity)

    def _moving(self, sampled, k, rows):
        def velocity(t):
            g = np.zeros(rows) if sampled is None else sampled(t)
            g[k] = g[k] + self.functions["g0"](t)
            return g

        return velocity


def MOTION(t, u, v):
    return -0.1 * v


def RESTORING(t, u, v):
    return 1.0 * u


def force_of(numbers, u, v):
    k, k3, c = numbers
    return float(k * u + k3 * u**3 + c * v)


def attempt(seed, counts, folder, library):
    """Compare one problem; AssertionError where a relation is broken."""
    drawn = Drawn(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            plain, coupler = drawn.coupler(False), drawn.coupler(True)
            drawn.start_specimens(plain)
        except (ValueError, pm.PmalphaError) as error:
            counts[f"not made: {type(error).__name__}"] += 1
            return
        path = folder / "x.pma"
        path.unlink(missing_ok=True)
        refusal = refusal_of(plain, path, drawn)
        if drawn.functions or drawn.specimens:
            assert drawn.specimens or refusal, "functions are in no file"
        try:
            if drawn.before:
                coupler.step(drawn.before)
            coupler.freeze(path, drawn.inputs, all_outputs(coupler))
        except ValueError as error:
            assert any(x in str(error) for x in NAMED), error
            assert not path.exists()
            assert is_right_to_refuse(drawn), error
            counts["refused"] += 1
            return
        assert not any(x["function"] for x in drawn.parts), "a function was left out"
        compare(drawn, plain, library.model(path), counts)


def refusal_of(plain, path, drawn):
    """Whether the coupler with its functions is refused, whatever the inputs."""
    try:
        plain.freeze(path, drawn.inputs)
    except ValueError as error:
        assert any(x in str(error) for x in NAMED), error
        assert not path.exists()
        return True
    path.unlink()
    return False


def is_right_to_refuse(drawn):
    """Functions that no input replaces, or one value for several substeps."""
    coarse = drawn.coupling in ("macro", "mean")
    moved = {port[1] for port in drawn.inputs.values() if port[0] != "velocity"}
    many = any(x["substeps"] > 1 and f"s{i}" in moved for i, x in enumerate(drawn.parts))
    return any(x["function"] for x in drawn.parts) or (coarse and many)


def compare(drawn, plain, model, counts):
    try:
        history = plain.run(steps=drawn.before + STEPS)
    except pm.PmalphaError as error:
        counts[f"not run: {type(error).__name__}"] += 1
        return
    expected = recorded(plain, history, model.substeps(), drawn.before)
    rows = [model.values]
    for k in range(STEPS * model.substeps()):
        set_inputs(drawn, model, k + drawn.before * model.substeps())
        assert model.advance(1) == OK, model.why
        rows.append(model.values)
    difference = np.array(rows) != expected
    assert not difference.any(), (
        f"{drawn.coupling}: {np.argwhere(difference)[0]} of {difference.shape}, "
        f"{np.abs(np.array(rows) - expected).max()}"
    )
    counts["equal"] += 1
    counts["inputs"] += len(drawn.inputs)


def set_inputs(drawn, model, done):
    """The values that count next, each for the time level at which it acts."""
    for i, (name, port) in enumerate(drawn.inputs.items()):
        if port[0] == "specimen":
            value = force_of(drawn.specimens[name], *model.command_of(i)[1][:2])
        else:
            t = (done + model.lead(i)) / model.substeps() * drawn.dt
            value = drawn.functions[name](t)
        assert model.set(i, value) == OK, model.why


def recorded(coupler, history, fine, before):
    """What a run has recorded from a macro step on, at fine steps, as `all_outputs` lists it."""
    steps = before + STEPS
    columns = []
    for name, _ in coupler._session.keys:
        for what in "uva":
            columns.append(held(getattr(history[name], what), steps * fine))
    columns.append(held(history.multipliers, steps * fine))
    return np.concatenate(columns, axis=1)[before * fine :]
