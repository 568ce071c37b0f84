"""What random problems have (problems.py): a function for each feature, which writes it."""

import numpy as np
from problems import FEATURES, NAMES, TIME_STEP, TUV, TUVQ, Feature, feature

# ---- features: schemes and steps ----------------------------------------------------------------


def scheme(name, text):
    def add(s, p, rng):
        p.arguments["scheme"] = text

    feature(name, group="scheme")(add)


scheme("generalized alpha", "pm.GeneralizedAlpha(0.8)")
scheme("rho 1/2", "pm.GeneralizedAlpha(rho=0.5)")
scheme("rho 1", "pm.GeneralizedAlpha(1)")
scheme("explicit generalized alpha", "pm.GeneralizedAlpha(0.8, explicit=True)")
scheme("explicit with rho 0.3", "pm.GeneralizedAlpha(3 / 10, explicit=True)")
scheme("central difference", "pm.CentralDifference()")
scheme("Newmark", "pm.Newmark()")
scheme("damped Newmark", "pm.Newmark(beta=0.3025, gamma=0.6)")
scheme("HHT", "pm.HHT(alpha=0.2)")
scheme("WBZ", "pm.WBZ(alpha=0.15)")
scheme("Scheme of four numbers", "pm.Scheme(am=0, af=0, beta=0.3025, gamma=0.6, explicit=False)")


@feature("Bathe", group="scheme")
def _bathe(s, p, rng):
    p.arguments["scheme"] = "pm.Bathe(gamma=None)"
    p.substeps = s.fine


@feature("substeps")
def _substeps(s, p, rng):
    p.substeps = s.fine


@feature("some substeps", group="substeps")
def _some_substeps(s, p, rng):
    p.substeps = int(rng.choice([d for d in range(1, s.fine + 1) if s.fine % d == 0]))


@feature("double steps", group="double")
def _double(s, p, rng):
    p.arguments["double_step"] = "True"


@feature("single steps", group="double")
def _single(s, p, rng):
    p.arguments["double_step"] = "False"


# ---- features: structures ------------------------------------------------------------------------


def structure(name, text, n):
    """Part of a structure, whose M, K and internal forces are its own."""

    def add(s, p, rng):
        p.M, p.K, p.order = np.eye(n), np.eye(n), np.arange(n)
        p.u0, p.v0 = np.zeros(n), np.zeros(n)
        p.head = f"structures.{text}.subdomain"
        p.built = True
        s.still |= {(p.index, i) for i in range(n)}

    FEATURES[name] = Feature(name, "subdomain", add, "head", True)


structure("rod", 'rod(2, 2.0, EA=4.0, rhoA=2.0, mass="lumped")', 3)
structure("long rod", "rod(40, 4.0, EA=0.04, rhoA=2.0)", 41)
structure("plate", "plate(3, 3, 1.0, E=2.0, nu=0.2, rho=1.5)", 32)
SOIL = 'E=1.0, nu=0.2, rho=1.0, plane="strain")'
structure("absorbing layer", f"plate(1, 1, 1.0, {SOIL}.absorbing_layer([2, 3], elements=3)", 48)
structure("graded damping", f"plate(3, 1, 1.0, {SOIL}.graded_damping([6, 7], elements=2)", 16)
structure(
    "chain with attachments",
    "chain(3, 1.5, 3.0).with_spring([(0, -1)], k=2.0, c=0.1).with_damper([(2, 1)], 0.1)",
    3,
)
structure(
    "truss",
    'truss([[0, 0], [2, 0]], [[0, 1]], EA=9.0, rhoA=2.0, strain="green", prestress=1.0)',
    4,
)


# A beam, and a point that enters it in the second step and changes elements in the fifth
BEAM = (
    "beam_frame([[0, 0], [2, 0]], [[0, 1]], EA=40.0, EI=1.0, rhoA=2.0, divisions=2)"
    ".with_spring([(0, -1), (1, -1), (4, -1)], k=20.0)"
)
POINT = f'structures.{BEAM}.moving_point([0, 2, 1], 5.0, start=-0.2, direction="uy", fixed=[])'
structure("beam with a moving load", BEAM, 9)
structure("beam with springs that move", BEAM, 9)


def on_beam(name):
    """Adds to a beam what `more` writes."""

    def added(more):
        of_beam = FEATURES[name].add

        def add(s, p, rng):
            of_beam(s, p, rng)
            more(s, p, rng)

        FEATURES[name] = Feature(name, "subdomain", add, "head", True)

    return added


@on_beam("beam with a moving load")
def _moving_load(s, p, rng):
    size = rng.choice(["0.5", "pm.SampledForce([0.0, 1.0, -0.5], dt=0.2)"])
    p.load(f"pm.MovingLoad({POINT}, {size})")


@on_beam("beam with springs that move")
def _moving_springs(s, p, rng):
    one = f'pm.CubicSpring([("rz 1", {POINT})], 2.0, k3=5.0)'
    two = f'pm.Gap([("ground", {POINT})], 2.0, 0.0, c=0.1)'
    three = f"pm.Bilinear([({POINT}, 0)], 2.0, fy=0.001)"
    p.forces.setdefault("restoring", []).append(rng.choice([one, two, three]))


# ---- features: matrices -------------------------------------------------------------------------


@feature("massless dof")
def _massless(s, p, rng):
    if p.built:
        return
    i = int(rng.integers(p.n))
    p.M[i] = 0.0
    p.light.add(i)


@feature("full mass")
def _full_mass(s, p, rng):
    if p.built:
        return
    x = np.where(np.diag(p.M) > 0.0, 0.5 * rng.normal(size=p.n), 0.0)
    p.M = np.round(p.M + np.outer(x, x), 3)


@feature("diagonal")
def _diagonal(s, p, rng):
    if p.built:
        return
    p.M, p.K = np.diag(np.diag(p.M)), np.diag(np.diag(p.K))
    p.arguments["M"] = p.vector(np.diag(p.M), force=1, time=2, length=-1)
    p.arguments["K"] = p.vector(np.diag(p.K), force=1, length=-1)


@feature("sparse")
def _sparse(s, p, rng):
    if p.built:
        return
    kind = rng.choice(["csr_array", "csc_matrix", "coo_array"])
    p.arguments["K"] = f"sp.{kind}({p.matrix(p.K, force=1, length=-1)})"


@feature("damping")
def _damping(s, p, rng):
    C = 0.2 * np.diag(np.diag(p.M)) + 0.02 * p.K
    light = [i in p.light for i in range(p.n)]
    C[light] = C[:, light] = 0.0
    p.C = C
    p.arguments["C"] = p.matrix(C, force=1, time=1, length=-1)


@feature("lagged damping")
def _lagged(s, p, rng):
    if "C" not in p.arguments:
        _damping(s, p, rng)
    p.arguments["damping"] = '"lagged"'


@feature("Rayleigh", group="Rayleigh")
def _rayleigh(s, p, rng):
    p.arguments["rayleigh"] = f"({p.number(0.1, time=-1)}, {p.number(0.01, time=1)})"


@feature("damping ratio", group="Rayleigh")
def _damping_ratio(s, p, rng):
    one, two = p.number(4.0, time=1), p.number(0.5, time=1)
    p.arguments["damping_ratio"] = f"{{{one}: 0.05, {two}: 0.03}}"


def skew(rng, p, size):
    moving = np.diag(p.M) > 0.0
    A = np.triu(rng.normal(size=(p.n, p.n)), 1) * np.outer(moving, moving) * size
    return A - A.T


@feature("gyroscopic")
def _gyroscopic(s, p, rng):
    C = getattr(p, "C", np.zeros((p.n, p.n))) + skew(rng, p, 1.0)
    p.arguments |= {"C": p.matrix(C, force=1, time=1, length=-1), "symmetric": "False"}


@feature("unsymmetric K")
def _unsymmetric(s, p, rng):
    if p.built:
        return
    K = p.K + skew(rng, p, 0.5)
    p.arguments |= {"K": p.matrix(K, force=1, length=-1), "symmetric": "False"}


@feature("names of dofs")
def _dof_names(s, p, rng):
    p.arguments["dof_names"] = repr([f"d{i}" for i in p.order])


# ---- features: other ways to make a subdomain ---------------------------------------------------


@feature("fixed dof", group="head")
def _fixed(s, p, rng):
    """One more dof, which is removed."""
    if p.built:
        return
    k = rng.uniform(1.0, 3.0)
    M, K = (np.diag(np.append(np.zeros(p.n), x)) for x in (1.0, k))
    M[:-1, :-1], K[:-1, :-1] = (A[np.ix_(p.order, p.order)] for A in (p.M, p.K))
    M = p.writing.text(M, force=1, time=2, length=-1)
    K = p.writing.text(K, force=1, length=-1)
    p.before.append(f"free = pm.reduce({M}, {K}, fixed=[{p.n}])")
    p.arguments |= {"M": "free.M", "K": "free.K"}


@feature("reduced", group="head")
def _reduced(s, p, rng):
    """By the dofs at its ends and one mode."""
    keep = sorted({p.dof(0), p.dof(p.n - 1)})
    how = f"modes={min(1, p.n - len(keep))}"
    if rng.random() < 0.5:
        how = f"omega={p.number(99.0, time=-1)}"
    if rng.random() < 0.5:
        how += ", scheme=pm.GeneralizedAlpha(0.9)"
    p.after.append(f"{p.name}, basis = {p.name}.reduced({keep}, {how})")
    p.tied = {i: keep.index(p.dof(i)) for i in (0, p.n - 1)}
    s.still |= {(p.index, i) for i in range(p.n)}


# ---- features: loads ----------------------------------------------------------------------------


def direction(p, rng, **units):
    return p.vector(p.moving(rng.normal(size=p.n)), **units)


@feature("constant load")
def _constant(s, p, rng):
    p.load(f"np.array({direction(p, rng, force=1)})")


@feature("function of time")
def _function_of_time(s, p, rng):
    rate = p.number(3.0, time=-1)
    p.load(f"lambda t: np.array({direction(p, rng, force=1)}) * np.cos({rate} * t)")


@feature("controller")
def _controller(s, p, rng):
    gain = p.vector(p.moving(np.full(p.n, 0.2)), force=1, time=1, length=-1)
    p.load(f"lambda t, u, v: -np.array({gain}) * v")


@feature("samples")
def _samples(s, p, rng):
    values, step = rng.normal(size=7).round(2).tolist(), p.number(0.07, time=1)
    average = bool(rng.random() < 0.5)
    shape = direction(p, rng, force=1)
    p.load(f"pm.SampledForce({values}, {step}, shape={shape}, average={average})")


@feature("ground motion")
def _ground_motion(s, p, rng):
    values, step = p.writing.text(rng.normal(size=7), length=1, time=-2), p.number(0.07, time=1)
    average = bool(rng.random() < 0.5)
    along = f", direction={p.vector(np.arange(1.0, p.n + 1.0))}"
    more = along if rng.random() < 0.5 or "beam" in p.head else ""  # with rotations it has to be
    if rng.random() < 0.5 and p.head == "pm.Subdomain" and not p.before:
        more += f", M={p.matrix(p.M, force=1, time=2, length=-1)}"
    p.load(f"pm.BaseAcceleration({values}{more}, dt={step}, average={average})")


@feature("ground motion by component")
def _along(s, p, rng):
    """Of dofs with names, where there are two components of one alone or of both."""
    values, step = p.writing.text(rng.normal(size=7), length=1, time=-2), p.number(0.07, time=1)
    if not p.built:
        p.arguments["dof_names"] = repr([f"u{'xy'[i % 2]} {i}" for i in p.order])
    along = '{"ux": 1.0, "uy": 0.4}' if p.n > 1 and rng.random() < 0.5 else '"ux"'
    p.load(f"pm.BaseAcceleration({values}, direction={along}, dt={step})")


@feature("compiled load")
def _compiled_load(s, p, rng):
    rate = p.number(2.0, time=-1)
    text = f"lambda t: np.array({direction(p, rng, force=1)}) * np.sin({rate} * t)"
    p.load(f'compiled.low_level("force", {text})')


# ---- features: forces that depend on the motion -------------------------------------------------


def law(p, rng, name):
    """Springs of a law in the units of the problem."""
    k = p.number(2.0, force=1, length=-1)
    fy, gap = p.number(0.5, force=1), p.number(0.02, length=1)
    k3, c = p.number(5.0, force=1, length=-3), p.number(0.1, force=1, time=1, length=-1)
    near, far = p.number(0.1, length=1), p.number(0.4, length=1)
    one, two = p.number(0.2, force=1), p.number(0.4, force=1)
    rule = rng.choice(["kinematic", "elastic"])
    where = repr(p.pairs(rng))
    return {
        "cubic": f"pm.CubicSpring({where}, {k}, k3={k3})",
        "damped cubic": f"pm.CubicSpring({where}, {k}, k3={k3}, c={c})",
        "gap": f"pm.Gap({where}, {k}, {gap}, sign={rng.choice([1, -1])})",
        "damped gap": f"pm.Gap({where}, {k}, {gap}, c={c})",
        "bilinear": f"pm.Bilinear({where}, {k}, fy={fy}, hardening=0.1)",
        "Bouc-Wen": f"pm.BoucWen({where}, {k}, fy={fy}, hardening=0.1, n=1.5, beta=0.6, gamma=0.4)",
        "Ramberg-Osgood": f"pm.RambergOsgood({where}, {k}, fy={fy}, n=5.0, alpha=1.0)",
        "multilinear": f'pm.Multilinear({where}, [({near}, {one}), ({far}, {two})], rule="{rule}")',
    }[name]


def springs(name):
    @feature(f"{name} springs")
    def restoring(s, p, rng):
        p.forces.setdefault("restoring", []).append(law(p, rng, name))

    @feature(f"iterated {name} springs")
    def internal(s, p, rng):
        p.forces.setdefault("internal", []).append(law(p, rng, name))


LAWS = "cubic", "damped cubic", "gap", "damped gap", "bilinear", "Bouc-Wen"
LAWS += "Ramberg-Osgood", "multilinear"
for _name in LAWS:
    springs(_name)


@feature("conserving springs")
def _conserving(s, p, rng):
    text = f"pm.DiscreteGradient({law(p, rng, 'cubic')})"
    if p.arguments["scheme"] == "pm.GeneralizedAlpha(0.8)":
        p.arguments["scheme"] = "pm.Newmark()"
    p.forces.setdefault("internal", []).append(text)


def specimen(p, rng, size=1.0):
    """A function of the displacements and velocities of all dofs, of a hardening, damped spring."""
    k = p.vector(p.moving(size * rng.uniform(0.5, 1.5, p.n)), force=1, length=-1)
    c, unit = p.number(0.05, time=1), p.number(1.0, length=1)
    return f"lambda {TUV}: np.array({k}) * ({unit} * np.tanh(u / {unit}) + {c} * v)"


@feature("specimen")
def _specimen(s, p, rng):
    p.forces.setdefault("restoring", []).append(specimen(p, rng))


@feature("compiled specimen")
def _compiled_specimen(s, p, rng):
    text = f'compiled.low_level("restoring", {specimen(p, rng)})'
    p.forces.setdefault("restoring", []).append(text)


@feature("estimated specimen")
def _estimated(s, p, rng):
    p.forces.setdefault("restoring", []).append(specimen(p, rng))
    k, c = p.moving(np.full(p.n, 1.5)), p.moving(np.full(p.n, 0.1))
    p.arguments["restoring_stiffness"] = p.vector(k, force=1, length=-1)
    p.arguments["restoring_damping"] = p.vector(c, force=1, time=1, length=-1)


@feature("iterated function")
def _iterated(s, p, rng):
    k, c = p.moving(np.full(p.n, 1.0)), p.moving(np.full(p.n, 0.1))
    k, c = p.vector(k, force=1, length=-1), p.vector(c, force=1, time=1, length=-1)
    unit = p.number(1.0, length=1)
    f = f"np.array({k}) * {unit} * np.sinh(u / {unit}) + np.array({c}) * v"
    tangents = f"np.diag({k} * np.cosh(u / {unit})), np.diag({c})"
    p.forces.setdefault("internal", []).append(f"lambda {TUVQ}: ({f}, {tangents})")


@feature("iterated function with history")
def _with_history(s, p, rng):
    k = p.vector(p.moving(np.full(p.n, 2.0)), force=1, length=-1)
    most = p.number(0.2, force=1)
    p.before += [
        f"def friction({TUVQ}):",
        f"    f = np.clip({k} * (u - q), -{most}, {most})",
        f"    K = np.diag(np.where(abs(f) < {most}, {k}, 0.0))",
        f"    return f, K, None, np.where(abs(f) < {most}, q, u - np.sign(f) * {most} / {k})",
    ]
    history, pattern = [0.0] * p.n, f"sp.eye_array({p.n})"
    text = f"pm.InternalForce(friction, history={history}, pattern={pattern})"
    p.forces.setdefault("internal", []).append(text)


# ---- features: rigs -----------------------------------------------------------------------------


def rigged(name, text):
    """A specimen behind devices: ``text.format(specimen)``."""

    def add(s, p, rng):
        inner = law(p, rng, "bilinear") if rng.random() < 0.5 else specimen(p, rng, 0.3)
        p.forces.setdefault("restoring", []).append(text.format(inner, rows=np.eye(p.n).tolist()))

    feature(name, group="rig", unscaled=True)(add)


rigged("late actuator", "rig.SimulatedActuator({0}, delay=0.02, max_steps=50)")
rigged(
    "actuator",
    "rig.SimulatedActuator({0}, order=1, frequency=20.0, damping=0.6, noise=1e-4,"
    " saturation=5.0, quantum=1e-5, seed=3)",
)
rigged("polynomial", "rig.Compensated(rig.SimulatedActuator({0}, delay=0.02), 0.02, order=2)")
rigged(
    "inverse",
    "rig.Compensated(rig.SimulatedActuator({0}, order=1, frequency=20.0), delay=0.008,"
    ' method="inverse", max_steps=60)',
)
rigged(
    "adaptive",
    'rig.Compensated(rig.SimulatedActuator({0}, delay=0.02), delay=0.01, method="adaptive")',
)
rigged("linkage", "rig.Linkage({0}, matrix={rows})")

LAG = "[[-50.0]], [[50.0]], [[1.0]], [[0.3]], dofs=[{0}]"


@feature("linear actuator", group="rig", unscaled=True)
def _linear_actuator(s, p, rng):
    options = 'delay=0.01, hold="zero", noise=1e-5, force_noise=1e-5, seed=2, max_steps=70'
    options += ", saturation=9.0, quantum=1e-6"
    text = f"rig.LinearActuator({LAG.format(p.dof(0))}, {options})"
    p.forces.setdefault("restoring", []).append(text)


@feature("model of an actuator", group="rig", unscaled=True)
def _model_of_actuator(s, p, rng):
    lag = f"rig.LinearActuator({LAG.format(p.dof(0))})"
    more = "bandwidth=2.0, feedback=0.5, variations=0.01, sigma=1e-4"
    text = f'rig.Compensated({lag}, method="model", model={lag}, {more})'
    p.forces.setdefault("restoring", []).append(text)


@feature("arms of actuators", group="rig", unscaled=True)
def _arms(s, p, rng):
    how = "arms=[(0.3, 0.45), (0.3, -0.45)]" if p.n == 2 else f"matrix={np.eye(p.n).tolist()}"
    text = f"rig.Linkage({specimen(p, rng, 0.3)}, {how})"
    p.forces.setdefault("restoring", []).append(text)


@feature("servo-hydraulic actuator", group="rig", unscaled=True)
def _servo(s, p, rng):
    options = "mass=3e-5, stiffness=1.0, damping=1e-3, gain=1.0, valve=(2.1e7, 425.0, 99976.0)"
    text = f"rig.servo_hydraulic({options}, leakage=3.3, interaction=4.2, dofs=[{p.dof(0)}])"
    p.forces.setdefault("restoring", []).append(text)


@feature("external specimen", group="rig")
def _external(s, p, rng):
    text = f"rig.External([{p.dof(0)}], force={p.number(0.3, force=1)})"
    p.forces.setdefault("restoring", []).append(text)


@feature("limits")
def _limits(s, p, rng):
    if "restoring" not in p.forces:
        _specimen(s, p, rng)
    size = {"displacement": {}, "velocity": {"time": -1}, "acceleration": {"time": -2}}
    words = [f"{x}={p.number(1e4, length=1, **more)}" for x, more in size.items()]
    words.append(f"force={p.number(1e4, force=1)}, energy={p.number(1e4, force=1, length=1)}")
    p.arguments["limits"] = f"rig.Limits({', '.join(words)})"


# ---- features: ties -----------------------------------------------------------------------------


def tied(part, i):
    return part.tied[i] if part.tied else part.dof(i)


@feature("tie", "tie", group="tie")
def _tie(s, k, rng):
    a, i, b, j = s.sides(k)
    s.ties.append(f"pm.tie({a.name}, [{tied(a, i)}], {b.name}, [{tied(b, j)}])")


@feature("general constraint", "tie", group="tie")
def _constraint(s, k, rng):
    a, i, b, j = s.sides(k)
    one, two = rng.uniform(0.5, 2.0, 2).round(2).tolist()
    rows = (
        f"[[{', '.join(repr(x * (m == tied(p, d))) for m in range(p.n))}]]"
        for p, d, x in ((a, i, one), (b, j, -two))
    )
    s.ties.append(f"pm.Constraint({{{a.name}: {next(rows)}, {b.name}: {next(rows)}}})")
    s.still |= {(a.index, i), (b.index, j)}


def points_of(part, start):
    """Coordinates on a line, in the order in which its dofs are."""
    return [float(start + i) for i in part.order]


@feature("coincident nodes", "tie", group="tie", unscaled=True)
def _coincident(s, k, rng):
    a, i, b, j = s.sides(k)
    points = f"{{{a.name}: {points_of(a, 0)}, {b.name}: {points_of(b, i)}}}"
    s.ties.append(f"pm.tie_coincident({points}, components=1, dofs_per_node=1, tol=0.1)")


@feature("interpolated nodes", "tie", group="tie", unscaled=True)
def _interpolated(s, k, rng):
    a, i, b, j = s.sides(k)
    if b.n == 1:
        return _tie(s, k, rng)
    s.still |= {(a.index, i)} | {(b.index, m) for m in range(b.n)}
    cells = f'[[{b.dof(0)}, {b.dof(min(1, b.n - 1))}]], cell="line", nodes_a=[{a.dof(i)}]'
    where = f"{a.name}, {points_of(a, 0)}, {b.name}, {points_of(b, i - 0.5)}"
    s.ties.append(f"pm.interpolate({where}, {cells}, components=1, dofs_per_node=1, tol=0.1)")


def contact_of(s, k, rng, more=""):
    a, i, b, j = s.sides(k)
    gap = s.number(0.01, length=1)
    s.ties.append(
        f"pm.contact({a.name}, [{tied(a, i)}], {b.name}, [{tied(b, j)}], gap={gap}{more})"
    )
    s.coupler.setdefault("coupling", '"gc"')


@feature("contact", "tie", group="tie")
def _contact(s, k, rng):
    contact_of(s, k, rng, f", restitution={rng.choice([0.0, 0.5])}")


@feature("contact with friction", "tie", group="tie")
def _friction(s, k, rng):
    a, i, b, j = s.sides(k)
    slide = f"([{tied(a, 0)}], [{tied(b, b.n - 1)}])"
    more = f", friction=0.3, tangents=[{slide}], name='rub {k}'"
    contact_of(s, k, rng, more + ", friction_static=0.5" * bool(rng.random() < 0.5))


@feature("contact of coincident nodes", "tie", group="tie", unscaled=True)
def _contact_coincident(s, k, rng):
    a, i, b, j = s.sides(k)
    points = f"{{{a.name}: {points_of(a, 0)}, {b.name}: {points_of(b, i)}}}"
    options = "gap=0.01, restitution=0.3, dofs_per_node=1, tol=0.1, name='nodes'"
    s.ties.append(f"pm.contact_coincident({points}, [1.0], {options})")


def row(part, i):
    return repr([[float(m == tied(part, i)) for m in range(part.n)]])


def motion(name, text):
    """A dof of a subdomain whose velocity is prescribed."""

    def add(s, p, rng):
        i = int(rng.integers(p.n)) if not p.tied else 0
        g = text.format(
            v=s.number(0.5, length=1, time=-1),
            w=s.number(3.0, time=-1),
            h=s.number(0.06, time=1),
            values=s.writing.text([[0.0], [0.4], [-0.2], [0.1]], length=1, time=-1),
            record=s.writing.text([0.0, 4.0, -2.0, 1.0], length=1, time=-2),
        )
        s.ties.append(f"pm.Constraint({{{p.name}: {row(p, i)}}}{g})")
        s.still.add((p.index, i))

    feature(name, group="motion")(add)


motion("held dof", "")
motion("prescribed velocity", ", velocity=lambda t: {v} * np.sin({w} * t)")
motion("sampled velocity", ", velocity=pm.SampledForce({values}, {h})")
motion("shaken support", ', velocity=pm.SupportMotion({record}, {h}, kind="acceleration")')


def obstacle(name, moves):
    def add(s, p, rng):
        i, gap = int(rng.integers(p.n)) if not p.tied else 0, s.number(0.02, length=1)
        move = f"lambda t: {s.number(0.1, length=1)} * np.sin({s.number(2.0, time=-1)} * t)"
        more = f", motion={move}" if moves else ""
        if p.n > 1 and not p.tied:
            slide = f"[{{{p.name}: {row(p, (i + 1) % p.n)}}}]"
            more += f", tangents={slide}, friction=0.2, friction_static=0.3"
        options = f"gap={gap}, restitution=0.2{more}, name='{name} {p.name}'"
        s.ties.append(f"pm.Contact({{{p.name}: {row(p, i)}}}, {options})")

    feature(name)(add)


obstacle("obstacle", moves=False)
obstacle("moving obstacle", moves=True)


# ---- features: the coupler ----------------------------------------------------------------------


def coupling(name):
    def add(s, place, rng):
        s.coupler["coupling"] = f'"{name}"'

    feature(name, "coupler", group="coupling")(add)


for _name in ("pm", "gc", "macro", "mean"):
    coupling(_name)


@feature("initial motion", "coupler")
def _initial(s, place, rng):
    for name, size in (("u0", 0.3), ("v0", 1.0)):
        for part in s.parts:
            setattr(part, name, rng.normal(size=part.n) * size)
    for a, b in zip(s.parts, s.parts[1:]):
        b.u0[0], b.v0[0] = a.u0[-1], a.v0[-1]


@feature("long step", "coupler")
def _long_step(s, place, rng):
    """Not all motion is resolved, and some of it may grow."""
    s.coupler["dt"] = s.number(10.0 * TIME_STEP, time=1)


@feature("plain start", "coupler")
def _plain(s, place, rng):
    s.coupler["start"] = '"plain"'


@feature("one thread", "coupler", group="threads")
def _one_thread(s, place, rng):
    s.coupler["threads"] = "1"


@feature("Newton's options", "coupler")
def _newton(s, place, rng):
    tangent = rng.choice(["full", "reuse"])
    s.coupler["newton"] = f'pm.Newton(tol=1e-9, iterations=60, tangent="{tangent}")'


# ---- features: a run ----------------------------------------------------------------------------


@feature("energies", "run")
def _energy(s, place, rng):
    s.run["energy"] = "True"


@feature("every second", "run")
def _every(s, place, rng):
    s.run["every"] = "2"


@feature("some dofs", "run")
def _record(s, place, rng):
    part = s.parts[0]
    s.run["record"] = f"{{{part.name!r}: [0]}}"


@feature("springs recorded", "run")
def _record_springs(s, place, rng):
    has = [p.name for p in s.parts if any("pm." in t for x in p.forces.values() for t in x)]
    s.run["record_springs"] = f"{{{(has or NAMES)[0]!r}: None}}"


@feature("outputs", "run")
def _outputs(s, place, rng):
    part = s.parts[0]
    weights = part.vector(np.round(rng.normal(size=part.n), 2))
    words = f'"sum": {weights}, "mixed": {{"u": {weights}, "a": {weights}}}'
    s.run["outputs"] = f"{{{part.name!r}: {{{words}}}}}"


@feature("absolute outputs", "run")
def _absolute(s, place, rng):
    part = s.parts[0]
    weights = part.vector(np.ones(part.n))
    words = ", ".join(f'"abs {x}": {{"absolute {x}": {weights}}}' for x in "uva")
    s.run["outputs"] = f"{{{part.name!r}: {{{words}}}}}"


@feature("rig recorded", "run")
def _rig_recorded(s, place, rng):
    s.run["rig"] = "True"


@feature("tolerance", "run", unscaled=True)
def _tolerance(s, place, rng):
    s.run["tolerance"] = "0.1"


@feature("until", "run", unscaled=True)
def _until(s, place, rng):
    s.run["until"] = "lambda now: now.t > 0.22"
