"""Questions of readers, and the page that answers each: entries of the index of the site.

The site's search looks among these entries too. `docs/check.py` asks each question.
"""

from pathlib import Path

QUESTIONS = {
    "couple two FE meshes": "model",
    "choose substeps": "tutorial",
    "choose a coupling": "choosing",
    "units": "units",
    "diverges": "diverges",
    "hybrid test": "rig",
    "own element": "own-element",
    "save and continue": "runs",
    "many earthquakes": "many",
    "mesh file": "model",
    "which step": "tutorial",
    "is my result right": "right",
    "error of a run": "right",
    "hdf5": "runs",
    "ParaView": "model",
    "progress bar": "runs",
    "stop when": "runs",
    "actuator delay": "actuators",
    "real time": "laboratory",
    "scikit-fem": "other-programs",
    "energy": "runs",
    "MPI": "many",
    "response spectrum": "model",
    "moving load": "moving",
}


def write(sources):
    """The main entries below the title of each page, in the copied sources."""
    for page in sorted(set(QUESTIONS.values())):
        path = Path(sources, "docs", f"{page}.md")
        title, rest = path.read_text().split("\n", 1)
        entries = [
            f"```{{index}} !{question}\n```" for question, at in QUESTIONS.items() if at == page
        ]
        path.write_text("\n\n".join([title, *entries, rest]))
