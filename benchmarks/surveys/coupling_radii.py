"""Spectral radii of coupled steps: what is stable, under which coupling, and without the drift.

    export PYTHONPATH=tests
    python benchmarks/surveys/coupling_radii.py [oscillators] [loops] [mean] [variants] [warnings]
        [--few]

`oscillators`: split oscillators, A implicit, B explicit with substeps or implicit, for every
coupling of the core. `loops`: random loops of three subdomains. `mean`: random split oscillators
under mean coupling. `variants`: ways to remove the drift, with tests/reference.py.
`warnings`: whether StabilityWarning of set-up is right, by the radius, of 1000 random chains. Each
line has the largest radius, and how many are above 1 + 1e-7: double eigenvalues of modulus one are
computed to the root of the rounding. `--few`: one problem in four.
"""

import argparse
import warnings
from collections import Counter
from dataclasses import replace
from itertools import product

import numpy as np
import reference
from coupled_problems import limit, loop, mean_problems, oscillator, radius, random_coupler

import pmalpha as pm

ALPHA, CD = pm.GeneralizedAlpha, pm.CentralDifference()
UNSTABLE = 1.0 + 1e-7
# The first seed of the survey of warnings.
FIRST = 26_000
B1, SUBSTEPS, SHARES = (0.01, 0.1, 1.0, 10.0, 100.0), (1, 2, 5, 20), (0.05, 0.3, 0.6, 0.85, 0.97)
PAIRS = {
    "rho 0": (ALPHA(0.0), ALPHA(0.0, explicit=True)),
    "rho 0.5": (ALPHA(0.5), ALPHA(0.5, explicit=True)),
    "rho 0.8": (ALPHA(0.8), ALPHA(0.8, explicit=True)),
    "rho 1": (ALPHA(1.0), ALPHA(1.0, explicit=True)),
    "trapezoidal, central": (pm.Newmark(), CD),
    "rho 0.5, central": (ALPHA(0.5), CD),
    "rho 0.8, central": (ALPHA(0.8), CD),
    "rho 0.9, implicit": (ALPHA(0.9), ALPHA(0.9)),
    "rho 1, implicit": (ALPHA(1.0), ALPHA(1.0)),
    "trapezoidal, implicit": (pm.Newmark(), pm.Newmark()),
    "central, central": (CD, CD),
}
# coupling, whether A takes double steps
COUPLINGS = [
    ("gc", False),
    ("pm", False),
    ("macro", False),
    ("macro", True),
    ("mean", False),
    ("mean", True),
]


def line(name, radii):
    radii = np.array(radii)
    print(f"{name:<46}{radii.max():14.9f}{(radii > UNSTABLE).sum():5d} of {radii.size}", flush=True)


def survey_oscillators(every):
    for (pair, schemes), (coupling, double) in product(PAIRS.items(), COUPLINGS):
        problems = [*product(B1, SUBSTEPS, SHARES)][::every]
        line(
            f"{name_of(coupling, double)}: {pair}",
            [
                radius(oscillator(b, schemes, s, x, double, coupling=coupling))
                for b, s, x in problems
                if not refused(coupling, schemes)
            ]
            or [np.nan],
        )


def name_of(coupling, double):
    return coupling + ", double step" * double


def refused(coupling, schemes):
    """By mean coupling: explicit schemes with rho < 0.5."""
    return coupling == "mean" and any(getattr(s, "rho", 1.0) < 0.5 for s in schemes if s.explicit)


def survey_loops(every):
    triples = {
        **{f"rho {r}, implicit": [ALPHA(r)] * 3 for r in (0.0, 0.5, 0.8, 1.0)},
        "trapezoidal": [pm.Newmark()] * 3,
        **{
            f"rho {r}, third explicit": [ALPHA(r), ALPHA(r), ALPHA(r, explicit=True)]
            for r in (0.0, 0.5, 0.8, 1.0)
        },
        "rho 0.5, third central": [ALPHA(0.5), ALPHA(0.5), CD],
        "trapezoidal, third central": [pm.Newmark(), pm.Newmark(), CD],
        "central": [CD] * 3,
    }
    for (triple, schemes), (coupling, double) in product(triples.items(), COUPLINGS):
        if refused(coupling, schemes) or (coupling == "pm" and schemes[0].explicit):
            continue
        common = coupling in ("gc", "pm")
        radii = [
            radius(loop(k, schemes, double, common, coupling=coupling)) for k in range(0, 60, every)
        ]
        line(f"{name_of(coupling, double)}: loops, {triple}", radii)


def survey_mean(every):
    for double in (False, True):
        name = "double step" if double else "single steps"
        radii = [radius(c) for c in mean_problems(int(double), 1200 // every, double)]
        line(f"mean, random oscillators, {name}", radii)


# ---- ways to remove the drift, in the reference -----------------------------------------------


VARIANTS = {
    "kept": None,
    "projection of u with Mbar": "projection",
    "g = -[u]/tau, tau = 20 dt": 20.0,
    "g = -[u]/tau, tau = 5 dt": 5.0,
}


def of_reference(scheme, m, k, substeps, double=False):
    parameters = {x: getattr(scheme, x) for x in ("am", "af", "beta", "gamma", "explicit")}
    one = np.ones((1, 1))
    return reference.Subdomain(m * one, k * one, **parameters, substeps=substeps, double=double)


def steppers_of(b1, schemes, substeps, share, coupling):
    mB = kA = 1.0 / (1.0 + b1)
    dt = share * substeps * limit(mB, b1 * kA, schemes[1])
    double = coupling == "pm"
    A = of_reference(schemes[0], b1 * mB, kA, 1, double)
    B = of_reference(schemes[1], mB, b1 * kA, substeps)
    L = [np.ones((1, 1)), -np.ones((1, 1))]
    if coupling == "macro":
        return [reference.MacroStepper(s, Li, dt) for s, Li in zip((A, B), L)], L
    steppers = [reference.Stepper(s, Li, dt, substeps) for s, Li in zip((A, B), L)]
    for x in steppers:
        x.begin_double_steps(None, "plain")
    return steppers, L


def gap_of(steppers, L):
    return reference.jump(L, [x.states[-1].u for x in steppers])


def feedback(steppers, L, variant):
    """Prescribed velocities that close the gap in this number of macro steps, if it is a number."""
    if not isinstance(variant, float):
        return 0.0
    return -gap_of(steppers, L) / (variant * steppers[0].dt)


def fine_macro_step(steppers, L, Lam, variant):
    """From macro time level 1 to 2 under pm or gc; the multipliers are no state."""
    fine, H = steppers[0].fine, reference.interface_matrix(steppers)
    g = feedback(steppers, L, variant)
    for k in range(fine + 1, 2 * fine + 1):
        for x in steppers:
            x.open(k)
        vf = reference.jump(L, [x.free_velocity(k) for x in steppers])
        Lam = np.linalg.solve(H, g - vf)
        for x in steppers:
            x.close(k, Lam)
    return Lam


def macro_step(steppers, L, Lam, variant):
    g = feedback(steppers, L, variant)
    free = [x.free_macro_run(Lam) for x in steppers]
    H = sum(x.L @ x.U[-1]["v"] for x in steppers)
    right = g - reference.jump(L, [states[-1].v for states in free])
    dLam = np.linalg.solve(H, right)
    for x, states in zip(steppers, free):
        x.add_link_response(states, dLam)
    return Lam + dLam


def project(steppers, L):
    """The gap at the end closed by Mbar^-1 L^T nu."""
    Y = [x.step.solve(x.step.L.T) for x in steppers]
    nu = np.linalg.solve(sum(Li @ y for Li, y in zip(L, Y)), -gap_of(steppers, L))
    for x, y in zip(steppers, Y):
        x.states[-1] = replace(x.states[-1], u=x.states[-1].u + y @ nu)


def reference_radius(steppers, L, variant):
    """Of the macro step, column by column."""
    macro = isinstance(steppers[0], reference.MacroStepper)
    take = macro_step if macro else fine_macro_step
    counts = [2 if x.subdomain.double else 1 for x in steppers]
    size = 5 * sum(counts) + 1
    G = np.empty((size, size))
    for column, unit in enumerate(np.eye(size)):
        numbers = iter(unit)
        for x, count in zip(steppers, counts):
            ss = x.subdomain.substeps
            kept = [
                reference.State(0.0, *(np.array([next(numbers)]) for _ in range(5)))
                for _ in range(count)
            ]
            x.states = [None] * (ss + 1 - count) + kept
        Lam = take(steppers, L, np.array([next(numbers)]), variant)
        if variant == "projection":
            project(steppers, L)
        ends = [x.states[len(x.states) - count :] for x, count in zip(steppers, counts)]
        values = [
            getattr(s, f) for states in ends for s in states for f in ("u", "v", "w", "a", "vf")
        ]
        G[:, column] = np.concatenate([*values, Lam if macro else np.zeros(1)])
    return float(np.max(np.abs(np.linalg.eigvals(G))))


def survey_variants(every):
    pairs = ("rho 0", "rho 0.5", "rho 0.8", "trapezoidal, central")
    problems = [*product(B1, SUBSTEPS, SHARES)][::every]
    for (name, variant), coupling, pair in product(VARIANTS.items(), ("gc", "pm", "macro"), pairs):
        radii = [
            reference_radius(*steppers_of(b, PAIRS[pair], s, x, coupling), variant)
            for b, s, x in problems
        ]
        line(f"{coupling}, {name}: {pair}", radii)


# ---- StabilityWarning ---------------------------------------------------------------------------


def survey_warnings(every):
    """How often StabilityWarning of set-up is right, by the spectral radius of a macro step."""
    counts = Counter()
    for seed in range(FIRST, FIRST + 1000, every):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                found = radius(random_coupler(seed))
            except pm.InstabilityError:
                found = np.inf
            except (pm.FactorizationError, ValueError) as error:
                counts[f"refused: {str(error)[:40]}"] += 1
                continue
        warned = any(issubclass(w.category, pm.StabilityWarning) for w in caught)
        # a triple eigenvalue of modulus one is computed to the third root of the rounding, 1e-5
        kind = "grows" if found > 1.0 + 1e-5 else "sound" if found <= UNSTABLE else "between"
        counts[kind, "warned" if warned else "silent"] += 1
        if warned != (kind == "grows"):
            print(seed, f"radius {found:.9f}", [str(w.message)[:150] for w in caught])
    for what, count in sorted(counts.items(), key=str):
        print(f"StabilityWarning, {what}: {count}")


SURVEYS = {
    "oscillators": survey_oscillators,
    "loops": survey_loops,
    "mean": survey_mean,
    "variants": survey_variants,
    "warnings": survey_warnings,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("surveys", nargs="*", choices=[*SURVEYS, []], default=[*SURVEYS])
    parser.add_argument("--few", action="store_true")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    for name in arguments.surveys:
        SURVEYS[name](4 if arguments.few else 1)


if __name__ == "__main__":
    main()
