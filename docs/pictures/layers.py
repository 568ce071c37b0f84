"""Draws the pictures of docs/layers.md and prints its table; a minute of processor time.

PYTHONPATH=tests python docs/pictures/layers.py
"""

import sys
from pathlib import Path

import lamb_problem as lamb
import matplotlib
import numpy as np

import pmalpha as pm
from pmalpha import plot

matplotlib.use("agg")
from matplotlib import pyplot as plt
from matplotlib.colors import PowerNorm
from PIL import Image

HERE = Path(__file__).parent
STEPS = 398
LOOK = plot.RC | {"svg.hashsalt": "pmalpha", "savefig.facecolor": "w"}


def errors():
    """(kind, elements, unknowns of the edge, largest, rms) of dashpots, graded damping, layers."""
    exact, box = lamb.reference(STEPS), lamb.soil()
    rows = []
    for n in (0, 10, 20, 40):
        soil = lamb.soil(beyond=0.1 * n)
        damped = soil.with_damping(soil.absorbing(lamb.edge(soil)).C)
        found = lamb.error(lamb.alone(damped, STEPS), exact)
        rows.append(("dashpots", n, soil.n - box.n, *found))
    for n, reflection in ((10, 0.9), (20, 0.5), (40, 0.3)):
        soil = lamb.soil(beyond=0.1 * n)
        damped = soil.graded_damping(lamb.edge(soil), n, reflection)
        rows.append(("graded", n, soil.n - box.n, *lamb.error(lamb.alone(damped, STEPS), exact)))
    for n in (3, 5, 8, 10):
        unknowns = box.absorbing_layer(lamb.edge(box), n).n
        rows.append(("layer", n, unknowns, *lamb.error(lamb.with_layer(n), exact)))
    return rows


def draw_errors(rows):
    with matplotlib.rc_context(LOOK):
        figure, ax = plt.subplots(figsize=(6.0, 2.9), layout="constrained")
        words = {"dashpots": "dashpots, with plain soil before them", "graded": "graded damping"}
        words["layer"] = "absorbing layer"
        for i, (kind, label) in enumerate(words.items()):
            x, y = np.array([(n, 100 * big) for k, n, _, big, _ in rows if k == kind]).T
            ax.semilogy(x, y, **plot.LINES[i], marker="o", ms=4, label=label)
        ax.set(xlabel="elements beyond the box", ylabel="largest error, % of the peak")
        ax.set_yticks([1, 10, 50], ["1", "10", "50"])
        ax.legend()
        figure.savefig(HERE / "layers-error.svg", metadata={"Date": None})
        plt.close(figure)


def motions():
    """|u| on the mesh of the box with a layer, with dashpots, and of the large mesh; times."""
    box, every = lamb.soil(), 6
    x, y = box.points.T
    large = lamb.soil(beyond=17.5)
    inside = large.nodes(lambda x, y: (abs(x) < 4.01) & (y > -4.01))
    fields = []
    layer = box.absorbing_layer(lamb.edge(box), 10)
    ground = box.subdomain(scheme=pm.CentralDifference(), force=lamb.pulse(box), name="soil")
    edge = layer.subdomain(scheme=pm.Newmark())
    ties = layer.tie(ground, edge)
    coupler = pm.Coupler([ground, edge], ties, dt=lamb.step_of(0.1), coupling="macro")
    fields.append(coupler.run(steps=STEPS, every=every, record={"soil": None})["soil"])
    dashpots = box.with_damping(box.absorbing(lamb.edge(box)).C)
    for structure, nodes in ((dashpots, np.arange(len(x))), (large, inside)):
        model = structure.subdomain(scheme=pm.CentralDifference(), force=lamb.pulse(structure))
        record = {0: structure.dofs(nodes)}
        run = pm.solve(model, dt=lamb.step_of(0.1), steps=STEPS, every=every, record=record)
        fields.append(run)
    shape = (81, 41)
    sizes = [np.linalg.norm(f.u.reshape(-1, *shape, 2), axis=3) for f in fields]
    return fields[0].t, sizes


def film(t, sizes):
    titles = ("absorbing layer of 10 elements", "dashpots", "a mesh without an end")
    with matplotlib.rc_context(LOOK):
        figure, axes = plt.subplots(3, 1, figsize=(4.4, 6.6), dpi=80, layout="constrained")
        images = []
        for ax, title, size in zip(axes, titles, sizes, strict=True):
            image = ax.imshow(
                size[0].T,
                origin="lower",
                extent=(-4, 4, -4, 0),
                cmap="magma",
                norm=PowerNorm(0.5, 0.0, 0.15),
            )
            ax.set(title=title, xticks=[], yticks=[])
            images.append(image)
        text = axes[0].text(0.02, 0.06, "", color="w", transform=axes[0].transAxes)

        frames = []
        for i in range(int(np.searchsorted(t, 1.2)), int(np.searchsorted(t, 13.0))):
            for image, size in zip(images, sizes, strict=True):
                image.set_data(size[i].T)
            text.set_text(f"t = {t[i]:.1f}")
            figure.canvas.draw()
            frames.append(Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[:, :, :3]))
        plt.close(figure)
    options = {"save_all": True, "append_images": frames[1:], "duration": 120, "loop": 0}
    frames[0].save(HERE / "layers.webp", quality=55, method=6, **options)


if __name__ == "__main__":
    rows = errors()
    for kind, n, unknowns, big, rms in rows:
        sys.stdout.write(f"| {kind} | {n} | {unknowns} | {100 * big:.3g} | {100 * rms:.3g} |\n")
    draw_errors(rows)
    film(*motions())
