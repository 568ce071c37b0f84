"""Draws the pictures of README.md, docs/budget.md, docs/diverges.md and docs/embedded.md, and the
schedules in the method and tutorial.

    python docs/pictures/draw.py

The first example is the code in README.md itself; its exact solution is a matrix exponential.
"""

import contextlib
import re
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.linalg import expm

import pmalpha as pm
from pmalpha import plot

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "notebooks"), str(ROOT / "benchmarks")]
COMPUTED = {"facecolor": "0.9", "edgecolor": "k", "linewidth": 0.8}
FINE = {"facecolor": "#A9CBE6", "edgecolor": "k", "linewidth": 0.8}
COLUMN = {"color": "k", "linestyle": "-", "linewidth": 1.2}
GROUND = {"color": "k", "linestyle": "-", "linewidth": 2.5}


def example(page="README.md"):
    """The names that the Python code of a page defines."""
    code = "".join(re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.DOTALL))
    names = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.chdir(folder),
        contextlib.redirect_stdout(None),
    ):
        exec(compile(code, page, "exec"), names)
    return names


def uncut(tower, rig):
    """M, K of the uncut structure of the example: the rig is at dof 0 of the tower."""
    M, K = np.diag(tower.M), np.array(tower.K)
    M[0, 0] += rig.M[0]
    K[0, 0] += rig.K[0]
    return M, K


def exact(M, K, u0, dt, steps):
    """Displacements (steps + 1, n) of a free vibration from u0, at rest."""
    n = len(u0)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), np.zeros((n, n))]])
    one = expm(dt * A)
    states = [np.append(u0, np.zeros(n))]
    for _ in range(steps):
        states.append(one @ states[-1])
    return np.array(states)[:, :n]


def error(u, reference):
    """Largest difference, relative to the largest displacement."""
    return np.abs(u - reference).max() / np.abs(reference).max()


def double_steps(tower, rig, dt):
    """The tower of the example under "pm", in one step, with a substep of 0.002 s of the base."""
    tower = pm.Subdomain(tower.M, tower.K, scheme=tower.scheme, u0=tower.u0, name="tower")
    rig = pm.Subdomain(rig.M, rig.K, scheme=rig.scheme, substeps=round(dt / 0.002), name="rig")
    ties = pm.tie(tower, [0], rig, [0])
    return pm.Coupler([tower, rig], ties, dt=dt, coupling="pm").run(20.0)["tower"]


# ---- pictures --------------------------------------------------------------------------------


def draw_uses(figure):
    """A stiff detail, a specimen, small elements, in a row or, in a tall figure, in a column."""
    wide = figure.get_figwidth() > figure.get_figheight()
    tower, specimen, solid = figure.subplots(*((1, 3) if wide else (3, 1)))

    _frame(tower, 0.5, 1.0, storeys=2)
    tower.add_patch(_box(0.2, 0.35, 1.6, 0.65, **FINE))
    tower.text(1.0, 0.67, "stiff base", ha="center", va="center")
    _label(tower, 1.7, 1.9, "10 ms")
    _label(tower, 1.95, 0.67, "2 ms")
    tower.plot([0, 2], [0.33, 0.33], **GROUND)
    tower.set_title("A stiff detail in a soft structure")

    _frame(specimen, 0.0, 1.35, storeys=2)
    specimen.text(0.5, 3.45, "computed", ha="center")
    specimen.plot([-0.1, 1.1], [1.35, 1.35], "k", linestyle=(0, (5, 3)), linewidth=0.8)
    specimen.add_patch(_box(1.95, 0.33, 0.22, 1.15, **FINE))
    specimen.add_patch(_box(2.5, 1.2, 0.5, 0.2, **COMPUTED))
    specimen.plot([2.17, 2.5], [1.3, 1.3], **COLUMN)
    specimen.plot([3.0, 3.0], [0.33, 1.9], **GROUND)
    specimen.plot([1.6, 3.0], [0.33, 0.33], **GROUND)
    arrow = {"arrowstyle": "-|>", "color": "k", "linewidth": 0.8, "mutation_scale": 8}
    specimen.annotate("", (1.9, 1.45), (1.0, 2.0), arrowprops=arrow)
    specimen.annotate("", (0.9, 1.2), (1.9, 0.8), arrowprops=arrow)
    specimen.text(1.55, 1.85, "displacement", ha="left")
    specimen.text(0.62, 0.66, "force", ha="left")
    specimen.text(2.3, -0.1, "specimen and actuator", ha="center")
    _label(specimen, -0.65, 2.5, "10 ms")
    _label(specimen, 2.3, 0.75, "1 ms")
    specimen.set_title("A specimen in a laboratory")

    _mesh(solid, (0.5, 0.35), (1.0, 2.1), (4, 8), COMPUTED)
    _mesh(solid, (0.3, 2.45), (1.4, 0.55), (14, 6), FINE)
    solid.plot([0, 2], [0.33, 0.33], **GROUND)
    _label(solid, 1.65, 1.4, "0.2 ms")
    _label(solid, 1.85, 2.72, "7 µs")
    solid.set_title("A large model with few small elements")

    for ax, limits in ((tower, (-0.6, 2.6)), (specimen, (-0.7, 3.2)), (solid, (-0.6, 2.7))):
        ax.set(xlim=limits, ylim=(-0.25, 3.8), aspect="equal")
        ax.axis("off")


def _box(x, y, width, height, **look):
    from matplotlib.patches import Rectangle

    return Rectangle((x, y), width, height, **look)


def _frame(ax, x, y, storeys):
    """A frame with rigid floors, one unit wide."""
    for storey in range(storeys):
        base = y + 0.85 * storey
        ax.plot([x + 0.05, x + 0.05], [base, base + 0.75], **COLUMN)
        ax.plot([x + 0.95, x + 0.95], [base, base + 0.75], **COLUMN)
        ax.add_patch(_box(x, base + 0.72, 1.0, 0.13, **COMPUTED))


def _mesh(ax, corner, size, count, look):
    width, height = np.divide(size, count)
    for i in range(count[0]):
        for j in range(count[1]):
            place = corner[0] + i * width, corner[1] + j * height
            ax.add_patch(_box(*place, width, height, **look | {"linewidth": 0.4}))


def _label(ax, x, y, text):
    ax.text(x, y, text, va="center", color="0.25", style="italic")


def draw_first_example(figure):
    """Roof displacement with the step of the example and with steps that are too long."""
    names = example()
    tower, rig, history = names["tower"], names["base"], names["history"]
    above, below = figure.subplots(2, 1, sharex=True)

    t = history["tower"].t
    reference = exact(*uncut(tower, rig), tower.u0, t[1], len(t) - 1)
    above.plot(t, reference[:, 2], color="0.75", linestyle="-", linewidth=3.0, label="exact")
    long = double_steps(tower, rig, 0.05)
    away = error(long.u, reference[:: round(long.t[1] / t[1])])
    label = f"dt = 0.05 s, double steps (error {away:.0%})"
    above.plot(long.t, long.u[:, 2], **plot.LINES[0], label=label)
    near = error(history["tower"].u, reference)
    label = f"the example (error {near:.1%})"
    above.plot(t, history["tower"].u[:, 2], **plot.LINES[3], label=label)
    above.set(ylabel="roof displacement", ylim=(-0.13, 0.13))
    above.legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 0.98))

    below.plot(history.multiplier_times, history.multipliers[:, 0], **plot.LINES[3])
    below.set(ylabel="interface force", xlabel="time (s)", xlim=(0.0, 20.0))


def draw_budget(figure):
    """How the error of a goal adds up: the README with one step, and a soil with a frame."""
    import one_per_cent

    left, right = figure.subplots(1, 2)
    problems = (("tower of README", 0.02), ("soil, frame, equipment", 0.02))
    for ax, (name, dt) in zip((left, right), problems):
        problem = one_per_cent.PROBLEMS[name]
        steps = round(problem.t_end / dt)
        coupler = problem.make(*one_per_cent.in_proportion(problem, steps))
        budget = coupler.error_budget(problem.goal, problem.t_end)
        for share, look in zip(budget.by_step.items(), plot.LINES):
            t = np.linspace(0.0, problem.t_end, share[1].size + 1)[1:]
            ax.plot(t, 100.0 * np.cumsum(share[1]) / abs(budget.value), label=share[0], **look)
        ax.set(xlabel="time (s)", title=name)
        ax.legend(loc="lower left")
    left.set_ylabel("error of the goal (%)")


def draw_diverges(figure):
    """What is wrong with runs of the frame of docs/diverges.md: growth, a lag, a gap."""
    page = example("docs/diverges.md")
    frame, M, K = page["frame"], page["M"], page["K"]
    grows, lags, gap = figure.subplots(1, 3)

    def roof(scheme, dt, steps):
        again = pm.Subdomain(M, K, scheme=scheme, v0=frame.v0)
        history = pm.Coupler([again], dt=dt).run(steps * dt)
        return history[0].t, 1e3 * history[0].u[:, -1]

    explicit = pm.GeneralizedAlpha(0.8, explicit=True)
    critical = pm.analysis.critical_step(pm.Subdomain(M, K, scheme=explicit))
    for factor, line in ((0.98, plot.LINES[3]), (1.02, plot.LINES[0])):
        steps = roof(explicit, factor * critical, 30)
        grows.plot(*steps, **line, label=f"{factor} of it")
    grows.set(title="A step above the critical one", ylabel="roof displacement (mm)")
    grows.set_ylim(-150.0, 150.0)

    for dt, line in ((0.002, plot.LINES[3]), (0.03, plot.LINES[0])):
        lags.plot(*roof(frame.scheme, dt, round(1.5 / dt)), **line, label=f"dt = {dt} s")
    lags.set(title="A step that is too coarse")

    for coupling, line in (("mean", plot.LINES[3]), ("gc", plot.LINES[0])):
        history = halves(frame.scheme, coupling).run(1.5)
        drift = 1e3 * history.displacement_jump[:, 0]
        gap.plot(history.macro_times, drift, **line, label=f'"{coupling}"')
    gap.set(title="Velocities are tied", ylabel="gap at an interface (mm)")

    for ax in (grows, lags, gap):
        ax.set_xlabel("time (s)")
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.25), ncols=2, columnspacing=1.0)


CALLS = {"read": COMPUTED, "set": COMPUTED, "advance": FINE, "command": FINE, "give": COMPUTED}
WIDTHS = 0.12, 0.1, 0.2, 0.23, 0.12


def draw_target(figure):
    """Two samples of a loop with a specimen: what is called when, and what answers what."""
    ax = figure.subplots()
    ax.set(xlim=(-1.35, 2.1), ylim=(-0.85, 1.75))
    ax.axis("off")
    for y, lane in ((1.15, "specimen"), (0.15, "loop"), (-0.6, "model")):
        _label(ax, -1.35, y, lane)
    for k in range(-1, 3):
        ax.plot([k, k], [-0.75, 1.55], color="0.7", linewidth=0.8, linestyle=":")
        _label(ax, k - 0.02, 1.68, r"$t_k$" if k == 0 else rf"$t_{{k{k:+}}}$")
        ax.plot([k], [-0.6], "ko", markersize=4)
    for k in range(2):
        _draw_sample(ax, k)
    ax.plot([-1.08, 2.1], [-0.6, -0.6], color="k", linestyle="-", linewidth=0.8)


def _draw_sample(ax, k):
    """The calls of sample k, the way of its command, and the reply to the command before."""
    x = float(k)
    for (name, look), width in zip(CALLS.items(), WIDTHS):
        ax.add_patch(_box(x, 0.0, width, 0.3, **look))
        ax.text(x + width / 2, 0.14, name, fontsize=7, ha="center", va="center")
        x += width
    arrow = {"arrowstyle": "->", "linewidth": 0.8}
    now, then = (("k", "k+1"), ("k+1", "k+2"))[k]
    ax.annotate("", (k + 0.05, 0.3), (k + 0.05, 1.0), arrowprops=arrow)
    ax.text(k + 0.08, 0.5, f"$r_{{{now}}}$", fontsize=9)
    ax.annotate("", (x - 0.05, 1.0), (x - 0.05, 0.3), arrowprops=arrow)
    ax.text(x - 0.02, 0.5, f"$d_{{{then}}}$", fontsize=9)
    ax.plot([x - 0.05, k + 1.0], [1.15, 1.15], color="#A9CBE6", linestyle="-", linewidth=6)
    ax.text((x + k + 1) / 2, 1.27, f"moves to $d_{{{then}}}$", fontsize=8, ha="center")
    step = arrow | {"connectionstyle": "arc3,rad=-0.15"}
    ax.annotate("", (k - 0.02, -0.56), (k - 0.98, -0.56), arrowprops=step)


def draw_steps(figure):
    """Two macro steps of two subdomains, and what their steps are called."""
    ax = figure.subplots()
    ax.set(xlim=(-2.1, 12.2), ylim=(-0.75, 2.2))
    ax.axis("off")
    for y, lane, count in ((1.0, "frame", 4), (0.0, "device", 12)):
        _label(ax, -2.1, y, lane)
        ax.plot([0, 12], [y, y], color="k", linestyle="-", linewidth=0.8)
        ax.plot(np.linspace(0, 12, count + 1), np.full(count + 1, y), "ko", markersize=4)
    for k, name in enumerate((r"$t_n$", r"$t_{n+1}$", r"$t_{n+2}$")):
        ax.plot([6 * k] * 2, [-0.15, 1.75], color="0.7", linewidth=0.8, linestyle=":")
        _label(ax, 6 * k - 0.15, -0.7, name)
    arrow = {"arrowstyle": "<->", "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
    for x, width, y, text in (
        (0, 6, 1.65, r"macro step, $dt$"),
        (6, 3, 1.22, r"substep of the frame, $dt / 2$"),
        (0, 1, 0.22, r"substep of the device, $dt / 6$: the fine step"),
    ):
        ax.annotate("", (x + width, y), (x, y), arrowprops=arrow)
        if width > 1:
            ax.text(x + width / 2, y + 0.1, text, fontsize=9, ha="center")
        else:
            ax.text(x, y + 0.1, text, fontsize=9)


# For each lane: fine steps in a substep.
LANES = {"fine": 1, "coarse": 3}


def draw_lead(figure):
    """Time levels, substeps of two subdomains, and where inputs act that are set at each level."""
    ax = figure.subplots()
    ax.set(xlim=(-1.1, 6.3), ylim=(-0.5, 2.3))
    ax.axis("off")
    for y, (lane, ratio) in zip((1.25, 0.0), LANES.items()):
        _label(ax, -1.1, y, f"{lane}:")
        ax.plot([0, 6], [y, y], color="k", linestyle="-", linewidth=0.8)
        for k in range(7):
            large = k % ratio == 0
            ax.plot([k], [y], "ko" if large else "k|", markersize=5 if large else 7)
        for k in range(6):
            _draw_lead(ax, y, k, ratio)
    for k in range(7):
        _label(ax, k - 0.08, -0.42, rf"$t_{k}$")


def _draw_lead(ax, y, k, ratio):
    """From the level at which an input is set to the one at which it acts: `pmalpha_lead` apart."""
    lead = ratio if k % ratio == 0 else 2 * ratio - k % ratio
    if k + lead > 6:
        return
    arrow = {"arrowstyle": "->", "linewidth": 0.9, "color": "C0" if k % ratio == 0 else "C1"}
    arrow["connectionstyle"] = f"arc3,rad={-0.9 if ratio == 1 else -0.22}"
    ax.annotate("", (k + lead, y + 0.08), (k, y + 0.08), arrowprops=arrow)


def halves(scheme, coupling):
    """The same frame cut at its second floor, under a sudden load there."""
    k = 5e6
    low = pm.Subdomain(
        [2e3, 1e3], [[2 * k, -k], [-k, k]], scheme=scheme, force=[0.0, 2e4], name="low"
    )
    K = [[k, -k, 0.0], [-k, 2 * k, -k], [0.0, -k, k]]
    high = pm.Subdomain([1e3, 2e3, 2e3], K, scheme=scheme, substeps=4, name="high")
    ties = pm.tie("low", [1], "high", [0])
    return pm.Coupler([low, high], ties, dt=0.005, coupling=coupling)


DRAWN = {
    "uses": (draw_uses, (8.0, 2.9)),
    "uses-column": (draw_uses, (3.2, 7.6)),
    "first-example": (draw_first_example, (8.0, 3.4)),
    "diverges": (draw_diverges, (8.0, 2.6)),
    "steps": (draw_steps, (8.0, 1.9)),
    "target": (draw_target, (8.0, 2.4)),
    "lead": (draw_lead, (8.0, 1.8)),
    "budget": (draw_budget, (8.0, 2.8)),
}
SCHEDULES = {"staggered": "gc", "interfield-parallel": "pm"}


def main():
    import matplotlib
    from drawings import timeline
    from matplotlib.figure import Figure

    # svg.hashsalt: the same picture gives the same file; a white ground for dark pages
    with matplotlib.rc_context(plot.RC | {"svg.hashsalt": "pmalpha", "savefig.facecolor": "w"}):
        pictures = {name: timeline(coupling) for name, coupling in SCHEDULES.items()}
        pictures["tutorial"] = example("docs/tutorial.md")["ax"].figure
        for name, (content, size) in DRAWN.items():
            pictures[name] = Figure(figsize=size, layout="constrained")
            content(pictures[name])
        for name, figure in pictures.items():
            path = ROOT / "docs" / "pictures" / f"{name}.svg"
            figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main()
