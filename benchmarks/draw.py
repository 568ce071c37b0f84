"""Tables and pictures of the pages below, from benchmarks/results.

Nothing is measured here. The tables are between the lines `<!-- name -->` and `<!-- end -->`.
"""

import csv
import re
from pathlib import Path

import numpy as np

from pmalpha.plot import LINES, RC

ROOT = Path(__file__).parent.parent
PAGES = (
    ROOT / "docs" / "performance.md",
    ROOT / "docs" / "measurements.md",
    ROOT / "benchmarks" / "README.md",
    ROOT / "docs" / "compared.md",
)
RESULTS = ROOT / "benchmarks" / "results"
PICTURES = ROOT / "docs" / "pictures"

ORIGIN = "machine", "versions", "date"
OVER = "step over limit"


def read(name):
    """Rows of a CSV file; numbers as floats."""
    with open(RESULTS / f"{name}.csv", newline="") as file:
        return [{k: _number(v) for k, v in row.items()} for row in csv.DictReader(file)]


def _number(text):
    try:
        return float(text)
    except ValueError:
        return text


def short(x):
    """Three digits of a number, or a text as it is."""
    if not isinstance(x, float):
        return str(x)
    if x == round(x) and abs(x) < 1e7:
        return f"{int(x)}"
    return f"{x:.3g}" if abs(x) < 1000.0 else f"{x:.0f}"


def table(rows):
    """Markdown of rows with equal keys, followed by machine, versions and date."""
    columns = [c for c in rows[0] if c not in ORIGIN]
    lines = [columns, ["---"] * len(columns), *[[short(r[c]) for c in columns] for r in rows]]
    text = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    origins = sorted({tuple(r[c] for c in ORIGIN) for r in rows if ORIGIN[0] in r})
    return text + "".join(f"\n\nMeasured on {m}; {v}; {d}." for m, v, d in origins)


def pick(name, columns, *problems):
    """Columns of a file by their names in the table, of all rows or those of some problems."""
    rows = [r for r in read(name) if not problems or r["problem"] in problems]
    return [{shown: row[column] for shown, column in columns.items()} for row in rows]


# ---- tables ----------------------------------------------------------------------------------


def target(what, limit, reached, unit, *, least=False):
    """A row of the table of targets; `limit` is a lower bound if `least`, else an upper bound."""
    good = reached >= limit if least else reached <= limit
    return {
        "quantity": what,
        "target": f"{'at least' if least else 'at most'} {short(limit)} {unit}".rstrip(),
        "reached": f"{short(reached)} {unit}".rstrip(),
        "": "yes" if good else "no",
    }


def targets():
    alone, plates = read("uncoupled"), read("plate")
    solids = [r["loop over ours"] for r in alone if r["problem"] == "solid"]
    one_face = [r["coupled over sum"] for r in read("coupling_cost") if r["faces"] == 1]
    fine = {r["what"]: 1e3 * r["us a fine step"] for r in read("fine_step")}
    rows = [
        target("SciPy loop over hex8 solids", 2.5, min(solids), "times", least=True),
        target(
            "SciPy loop over coupled plates, the smallest ratio of all meshes",
            2.5,
            min(r["loop over ours"] for r in plates),
            "times",
            least=True,
        ),
        target("coupled over uncoupled steps, one face, the largest ratio", 1.1, max(one_face), ""),
        target("fine step of four dofs", 60.0, fine["step, not recorded"], "ns"),
        target("the same with all recorded", 120.0, fine["run, all recorded"], "ns"),
    ]
    rows += [
        target(f"{r['problem']}, {short(r['n'])} dofs, over the limit", r["target"], r[OVER], "")
        for r in read("limits")
    ]
    row = next(
        r for r in read("growth") if r["problem"] == "subdomains in a row" and r["size"] == 1e3
    )
    rows += [
        target("set-up of 1000 subdomains in a row", 1.0, row["set-up s"], "s"),
    ]
    cases = {r["problem"]: r for r in read("cases")}
    rows += [
        target(f"eight load cases over one, {name}", limit, cases[name]["eight over one"], "")
        for name, limit in (("four dofs, ss = 20", 2.0), ("hex8, n = 29 106", 2.5))
    ]
    study = cases["frame with springs, all recorded"]["gain"]
    rows.append(target("study of records by run_each", 4.0, study, "times", least=True))
    newton = read("newton")
    ratio = "that over this"
    over = [1.0 / r[ratio] for r in newton if r["what"] == "an iteration" and r["dofs"] > 30_000]
    rows.append(target("iteration of 10 000 hexahedra over its parts", 1.3, max(over), ""))
    rows += [
        target(
            f"{other} over plastic frames, the smallest ratio",
            50.0,
            min(r[ratio] for r in newton if r["compared with"] == other),
            "times",
            least=True,
        )
        for other in dict.fromkeys(r["compared with"] for r in newton if r["what"] == "a step")
    ]
    stages = {r["what"]: r for r in read("large")}
    peak = max(r["MB peak"] for r in stages.values() if r["MB peak"] != "")
    return [
        *rows,
        target("1e6 explicit and 1e5 implicit dofs: memory", 12.0, peak / 1e3, "GB"),
        target("the same: set-up, processor time", 60.0, stages["Coupler"]["processor s"], "s"),
    ]


def large():
    """The stages; the functions of set-up are in the file only."""
    columns = "what", "seconds", "processor s", "MB peak"
    rows = [r for r in read("large") if not r["what"].startswith("of set-up")]
    return [{c: row[c] for c in columns} for row in rows]


SIZES = {"problem": "problem", "dofs": "dofs", "set-up s": "set-up s"}
SIZES |= {"step ms": "macro step ms", "MB before": "MB before", "MB peak": "MB peak"}
MANY = {"problem": "problem", "size": "size", "constraints": "constraints"}
MANY |= {x: x for x in ("set-up s", "macro step ms", "MB peak")}
TIED = ("subdomains", "dofs per subdomain", "faces", "substeps of the neighbours", "constraints")
TIED += ("coupled over sum", "limit: untied over sum")
SUBCYCLED = "schemes", "dofs", "stiff share", "subcycled ms", "uncut at the fine step ms", "ratio"
NEWTON = "problem", "dofs", "what", "iterations a step", "us", "compared with", "that over this"
THREADS = "problem", "size", "us a macro step", "two over one", "threads by None", "none over one"
PLATE = {x: x for x in ("mesh", "dofs per subdomain", "macro step ms", "loop over ours")}
PLATE |= {"Kratos over ours": "Kratos over ours", "difference of Kratos": "difference of Kratos"}
UNCOUPLED = "problem", "n", "us a step", "us a step of the loop", "loop over ours"
EXECUTED = "problem", "by", "workers", "us a case, workers", "us a case, program", "efficiency"
CUBES = "explicit hex8, dofs", "implicit hex8, dofs"
SCALED = "what", "step over own", "mass added %", "processor s", "faster", "error"
ROW, GRID = "subdomains in a row", "subdomains in a grid"


def same(*columns):
    return {x: x for x in columns}


TABLES = {
    "targets": targets,
    "sizes": lambda: [
        row | {"problem": row["problem"].removesuffix(", dofs")}
        for row in pick("growth", SIZES | same(*ORIGIN), *CUBES)
    ],
    "many": lambda: pick(
        "growth", MANY, ROW, GRID, "constraints, implicit", "constraints, explicit"
    ),
    "small": lambda: pick("setting_up", same("what", "ms", "over", "ratio", *ORIGIN)),
    "large": large,
    "uncoupled": lambda: pick("uncoupled", same(*UNCOUPLED)),
    "plate": lambda: pick("plate", PLATE),
    "coupling_cost": lambda: pick("coupling_cost", same(*TIED)),
    "subcycling": lambda: pick("subcycling", same(*SUBCYCLED)),
    "fine_step": lambda: read("fine_step"),
    "instructions": lambda: read("instructions"),
    "limits": lambda: read("limits"),
    "threads": lambda: pick(
        "threads", same(*THREADS), "balanced, gc", "parallel to 20 substeps", "split"
    ),
    "ensembles": lambda: read("ensembles"),
    "executors": lambda: pick("executors", same(*EXECUTED)),
    "cases": lambda: pick(
        "cases", same("problem", "one, us a macro step", "eight, us a macro step", "gain")
    ),
    "newton": lambda: pick("newton", same(*NEWTON)),
    "subcycled_energy": lambda: subcycled_energy(),
    "one_per_cent": lambda: read("one_per_cent"),
    "mass_scaling": lambda: pick("mass_scaling", same(*SCALED, *ORIGIN)),
}


METHODS = {
    "gc": '"gc"',
    "pm": '"pm"',
    "macro": '"macro"',
    "mean": '"mean"',
    "nodal": "nodal subcycling",
}


def subcycled_energy():
    """Lowest, highest and last energy of each method, for each ratio of steps."""
    results = read("subcycled_energy")
    origin = {x: results[0][x] for x in ORIGIN}
    ratios = sorted({row["ratio"] for row in results})
    table = []
    for column, name in METHODS.items():
        line = {"": name}
        for ratio in ratios:
            energy = [1.0 + row[column] for row in results if row["ratio"] == ratio]
            extremes = f"{min(energy):.5f}, {max(energy):.5f}, {energy[-1]:.5f}"
            line[f"ratio {short(ratio)}: lowest, highest, end"] = extremes
        table.append(line | origin)
    return table


def page(text):
    """The page with its tables written anew."""

    def written(match):
        return f"<!-- {match[1]} -->\n\n{table(TABLES[match[1]]())}\n\n<!-- end -->"

    return re.sub(r"<!-- (\w+) -->\n.*?<!-- end -->", written, text, flags=re.DOTALL)


# ---- pictures --------------------------------------------------------------------------------


def draw_plate(figure):
    """Time per macro step of each program, for each mesh."""
    rows = read("plate")
    ax = figure.subplots()
    kinds = [
        ("macro step ms", "pmalpha", 3),
        ("loop ms", "SciPy loop", 2),
        ("Kratos ms", "Kratos", 0),
    ]
    for i, (column, label, line) in enumerate(kinds):
        heights = [row[column] or np.nan for row in rows]  # empty where it is not installed
        ax.bar(np.arange(len(rows)) + 0.25 * i, heights, 0.22, label=label, **_fill(line))
    names = [f"{r['mesh']}\n{short(r['dofs per subdomain'])} dofs" for r in rows]
    ax.set_xticks(np.arange(len(rows)) + 0.25, names)
    ax.set(yscale="log", ylabel="time of a macro step (ms)")
    ax.legend()


def _fill(line):
    return {"color": LINES[line]["color"]}


def draw_coupling(figure):
    """Coupled over uncoupled steps; measured against theoretical gain of subcycling."""
    left, right = figure.subplots(1, 2)
    rows = read("coupling_cost")
    for substeps, line in ((1.0, 2), (10.0, 0)):
        own = [r for r in rows if r["substeps of the neighbours"] == substeps]
        where = np.arange(len(own)) + (0.35 if substeps > 1.0 else 0.0)
        values = [r["coupled over sum"] for r in own]
        label = "all implicit" if substeps == 1.0 else "explicit neighbours, ss = 10"
        left.barh(where, values, 0.32, label=label, **_fill(line))
    names = [
        f"{r['subdomains']}, {short(r['dofs per subdomain'])} dofs, {short(r['faces'])} f."
        for r in own
    ]
    left.set_yticks(np.arange(len(own)) + 0.17, names)
    left.axvline(1.0, color="0.4", linewidth=0.8)
    left.invert_yaxis()
    left.set(xlabel="ratio of times", title="Coupled step over the sum of uncoupled steps")
    left.legend()
    rows = read("subcycling")
    for schemes, line in (("explicit", 0), ("implicit", 2)):
        own = [r for r in rows if r["schemes"] == schemes]
        x, y = ([r[c] for r in own] for c in ("theoretical ratio", "ratio"))
        right.plot(x, y, "o", label=f"both {schemes}", **_fill(line))
    ends = [0.04, 0.5]
    right.plot(ends, ends, color="0.4", linestyle="-", linewidth=0.8)
    right.set(xscale="log", yscale="log")
    ticks = [0.05, 0.1, 0.2, 0.4]
    for axis in (right.xaxis, right.yaxis):
        axis.set_ticks(ticks, [str(x) for x in ticks])
        axis.set_ticks([], minor=True)
    right.set(xlabel="theoretical ratio of times", ylabel="measured ratio of times")
    right.set_title("Subcycled run over the uncut run at the fine step")
    right.legend()


def draw_growth(figure):
    """Step, set-up and memory over dofs, constraints and subdomains."""
    axes = figure.subplots(3, 3, sharex="col")
    rows = read("growth")
    columns = ["dofs", "constraints", "subdomains"]
    lines = {}
    for problem in dict.fromkeys(r["problem"] for r in rows):
        own = [r for r in rows if r["problem"] == problem]
        column = next(i for i, word in enumerate(columns) if word in problem)
        style = LINES[3 - 2 * lines.setdefault(column, 0)]
        lines[column] += 1
        label = problem.replace(", dofs", "").replace("constraints, ", "")
        label = label.replace("subdomains ", "")
        x = [r["size"] for r in own]
        for row, y in enumerate(
            (
                [r["macro step ms"] for r in own],
                [r["set-up s"] for r in own],
                [r["MB peak"] - r["MB before"] for r in own],
            )
        ):
            axes[row, column].plot(x, y, marker="o", markersize=3, label=label, **style)
    for ax in axes.flat:
        ax.set(xscale="log", yscale="log")
        ax.yaxis.set_minor_formatter("")  # labels of powers of ten only, also on short axes
    axes[2, 2].set_ylim(1.0, 100.0)
    for ax, word in zip(axes[2], columns):
        ax.set_xlabel(word)
    for ax, word in zip(axes[:, 0], ("macro step (ms)", "set-up (s)", "memory of set-up (MB)")):
        ax.set_ylabel(word)
    for ax in axes[0]:
        ax.legend()


# What the functions of the core do, in the order of a step; a name ends as one of these
STAGES = {
    "predictor": ("predict",),
    "product with K": ("subtract", "subtract_band", "subtract_strips", "subtract_rows"),
    "forward sweep": ("eliminate",),
    "backward sweep": ("substitute", "substitute_supernode"),
    "corrector": ("correct",),
    "open and close": ("substep_open", "substep_close", "open_part", "close_part"),
    "interface": ("load_interface", "factor_interface", "free_velocity", "coupler_solve"),
    "schedule": ("fine_steps", "open_substeps", "close_substeps"),
}


def _stage(function):
    name = function.removesuffix("_avx2")
    return next((x for x, ends in STAGES.items() if name.endswith(ends)), "others")


def draw_step(figure):
    """Share of each stage in a step."""
    ax = figure.subplots()
    rows = read("step_profile")
    problems = list(dict.fromkeys(r["problem"] for r in rows))
    for position, problem in enumerate(problems):
        own = [r for r in rows if r["problem"] == problem]
        begin = 0.0
        for i, stage in enumerate([*STAGES, "others"]):
            share = sum(r["share"] for r in own if _stage(r["function"]) == stage)
            grey = 0.72 + 0.18 * (i % 2)
            ax.barh(position, share, 0.8, begin, color=str(grey), edgecolor="w", linewidth=0.5)
            if share > 0.04:
                words = stage.replace(" and ", " and\n").replace(" with", "\nwith")
                words = words.replace(" sweep", "\nsweep")
                middle = begin + share / 2.0
                look = {"rotation": 90, "fontsize": 7} if share < 0.075 else {}
                ax.text(middle, position, words, ha="center", va="center", **look)
            begin += share
    ax.set_yticks(range(len(problems)), problems)
    ax.invert_yaxis()
    ax.grid(False)
    ax.set(xlim=(0.0, 1.0), xlabel="share of the time of a step")


def draw_energy(figure):
    """Energy over time while the pulse crosses, for the larger ratio."""
    ax = figure.subplots()
    results = read("subcycled_energy")
    largest = max(row["ratio"] for row in results)
    chosen = [row for row in results if row["ratio"] == largest]
    for i, (column, name) in enumerate(METHODS.items()):
        share = [100.0 * row[column] for row in chosen]
        ax.plot([row["t us"] for row in chosen], share, label=name, **LINES[i % len(LINES)])
    ax.axvspan(24.1, 34.1, color="0.93")  # 125 mm at c, and the pulse of 10 us
    ax.set(xlabel="time (us)", ylabel="change of the energy (%)")
    ax.legend()


def draw_scaling(figure):
    """Error over speed-up of the scaled mesh and of the cut one."""
    ax = figure.subplots()
    results = [row for row in read("mass_scaling") if row["error"] > 0.0]
    scaled, cut = (
        [r for r in results if (r["what"] == "mass scaling") == x] for x in (True, False)
    )
    for rows, name, style in ((scaled, "mass scaling", LINES[0]), (cut, "cut", LINES[1])):
        ax.plot(*([r[x] for r in rows] for x in ("faster", "error")), "o", label=name, **style)
    for row in results:
        words = f"x {short(row['step over own'])}" if row in scaled else row["what"]
        place = {"textcoords": "offset points", "xytext": (5, 5), "fontsize": 8}
        ax.annotate(words, (row["faster"], row["error"]), **place)
    ax.axhline(0.01, color="0.6", linewidth=0.8)
    ax.set(xscale="log", yscale="log", xlabel="times faster than the uncut mesh", ylabel="error")
    ticks = [5, 10, 20, 30]
    ax.xaxis.set_ticks(ticks, [str(x) for x in ticks])
    ax.xaxis.set_ticks([], minor=True)
    ax.legend(loc="center right")


DRAWN = {
    "scaling": (draw_scaling, (6.0, 3.2)),
    "energy": (draw_energy, (6.0, 3.2)),
    "plate": (draw_plate, (6.0, 3.0)),
    "coupling": (draw_coupling, (9.0, 3.4)),
    "growth": (draw_growth, (9.0, 7.0)),
    "step": (draw_step, (9.0, 4.2)),
}


def draw():
    """Draws all pictures into docs/pictures; the same results give the same files."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(RC | {"svg.hashsalt": "pmalpha", "axes.axisbelow": True}):
        for name, (content, size) in DRAWN.items():
            figure = Figure(figsize=size, layout="constrained")
            content(figure)
            figure.savefig(PICTURES / f"performance-{name}.svg", metadata={"Date": None})


def main():
    for path in PAGES:
        path.write_text(page(path.read_text()))
    draw()


if __name__ == "__main__":
    main()
