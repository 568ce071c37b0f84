"""Objects of the C extension and their arguments, to be replaced one by one by invalid ones."""

import numpy as np
import pytest
import scipy.sparse as sp
import waits
from scipy.linalg import cython_blas

from pmalpha import _core
from pmalpha.problem import forms
from pmalpha.problem.schemes import StepConstants
from pmalpha.results.quantities import CoreRecord, CoreSelection


def i64(*x):
    return np.array(x, dtype=np.int64)


def i32(*x):
    return np.array(x, dtype=np.int32)


def f64(*x):
    return np.array(x, dtype=np.float64)


def step(h=0.1):
    """The constants of the trapezoidal rule."""
    return (h, h * h / 4.0, h / 2.0, 0.0, h * h / 4.0, 0.0, h / 2.0, 0.0, 0.0, 1.0)


def operator(n=2, h=0.1):
    """(constants, inverse, R) of a unit matrix."""
    return step(h), np.ones(n), None


def subdomain_arguments(**others):
    """Two masses, the last one in the only constraint; trapezoidal rule."""
    parts = {"n": 2, "nb": 1, "substeps": 1, "K": f64(4.0, 9.0), "C": None}
    h = 0.1 / max(others.get("substeps", 1), 1)  # of a macro step of 0.1
    parts |= {"single": operator(h=h), "twice": None}
    parts |= {"link": (1, i64(0, 1), i32(0), f64(1.0))}
    return parts | others


# In these arguments and fields a form is a tuple of as many items as it has, which saves its name.
MATRICES = {1: forms.Band, 3: forms.Compressed, 5: forms.Strips}
FACTORS = {1: forms.Band, 3: forms.Compressed, 5: forms.Panels}
FORMS = {
    "single": {3: forms.StepOperator},
    "twice": {3: forms.StepOperator},
    "link": {4: forms.Columns},
    "mass": {2: forms.Factor},
    "restoring": {3: forms.Restoring},
    "internal": {3: forms.Internal},
    "iterate": {7: forms.Iterate},
    "impulse": {4: forms.Impulse},
    "H": {2: forms.Factor},
    "H_start": {2: forms.Factor},
    "R": FACTORS,
    "step": {10: StepConstants},
    "pattern": {6: forms.Numeric},
    "structure": {5: forms.Supernodes},
    "B": {4: forms.Columns},
} | {name: MATRICES for name in ("K", "C", "D_r", "K_r", "M", "M_size")}
ITEMS = {
    "springs": {4: forms.Springs},
    "forces": {5: forms.InternalForce},
    "functions": {8: forms.Specimen},
    "filters": {10: forms.Actuator, 6: forms.Adaptive},
}


def form_of(value, forms_of):
    """A plain tuple as one of these forms, with its items as theirs; all else as it is."""
    form = forms_of.get(len(value)) if type(value) is tuple else None
    if form is None:
        return value
    return form(*(named(name, x) for name, x in zip(form._fields, value)))


def named(name, value):
    """The value of this argument or field as its form, or as a tuple of forms."""
    if name in ITEMS and type(value) is tuple:
        return tuple(form_of(x, ITEMS[name]) for x in value)
    return form_of(value, FORMS.get(name, {}))


def subdomain(**others):
    arguments = subdomain_arguments(**others)
    return _core.Subdomain({x: named(x, value) for x, value in arguments.items()})


ONE = forms.Factor(np.ones(1), None)  # of a 1 x 1 unit matrix
NONE = forms.Factor(np.empty(0), None)


def coupler_arguments(**others):
    parts = {"subdomains": (subdomain(),), "p": 1, "H_start": ONE, "H": ONE}
    return parts | {"motions": (), "options": {"dt": 0.1, "rebased": True}} | others


def coupler(**others):
    arguments = {"schedule": "fine"} | coupler_arguments(**others)
    apart = {x: arguments.pop(x) for x in ("subdomains", "processes") if x in arguments}
    if type(arguments["motions"]) is tuple:
        arguments["motions"] = tuple(forms.Motion(rows, None) for rows in arguments["motions"])
    return _core.Coupler(**apart, parts={x: named(x, value) for x, value in arguments.items()})


def started(motions=(), subdomains=None, **of_subdomain):
    """A coupler of one subdomain that moves, and the subdomain."""
    s = subdomain(**of_subdomain) if subdomains is None else subdomains[0]
    c = coupler(subdomains=(s,) if subdomains is None else subdomains, motions=motions)
    s.start(f64(1.0, 0.5), f64(0.0, 0.25), f64(-4.0, -4.5), np.zeros(1))
    c.start(0, np.zeros(1), np.zeros(1))
    return c, s


def record(rows=11, *, macro_rows=None, begin=0, every=0, parts=1, p=1, position=(0, 1), **others):
    columns = len(position)

    def nodes():
        arrays = {x: np.zeros((rows, columns)) for x in "uva"} | {"position": i64(*position)}
        arrays |= others
        return CoreSelection(**arrays, springs=None, outputs=None, internal=None)

    macro = rows if macro_rows is None else macro_rows
    jumps = np.zeros((rows, p)), np.zeros((rows, p)), np.zeros((macro, p))
    return CoreRecord(begin, every, tuple(nodes() for _ in range(parts)), *jumps)


def in_a_process(code):
    """The output of another Python process with these helpers."""
    head = "import gc, signal, threading\nimport numpy as np, scipy.sparse as sp, waits\n"
    head += "from core_objects import *\nfrom pmalpha import _core\n"
    done = waits.program(head + code)
    return done.stdout + done.stderr


REFUSED = (TypeError, ValueError, OverflowError)  # never SystemError, which is a bug of the binding


def check_refused(call):
    with pytest.raises(REFUSED):
        call()


def panels_of(A, nb=0):
    """A matrix and the arguments of factor_panels for it."""
    S = sp.csr_array(A)
    matrix = S.indptr.astype(np.int64), S.indices.astype(np.int32), S.data
    structure = _core.supernodes(*matrix[:2], nb)
    return matrix, structure, np.zeros(structure[3][-1]), np.zeros(S.shape[0])


BLAS = tuple(cython_blas.__pyx_capi__[name] for name in ("dgemm", "dtrsm"))
SPD = 4.0 * np.eye(6) - np.eye(6, k=1) - np.eye(6, k=-1)
# two full blocks, coupled by their last dofs: two supernodes, the first with rows below
TWO_BLOCKS = np.kron(np.eye(2), np.ones((60, 60))) + 200.0 * np.eye(120)
TWO_BLOCKS[50:60, 110:] = TWO_BLOCKS[110:, 50:60] = 1.0


def factor(matrix, structure, values, inverse, lost=1e-14, blas=BLAS, threads=2):
    ptr, indices, entries = (*(matrix or ()), None, None, None)[:3]
    names = ("first", "row_ptr", "rows", "start", "owner")
    pattern = {
        "ptr": ptr,
        "indices": indices,
        "structure": structure and dict(zip(names, structure)),
        "dgemm": blas[0],
        "dtrsm": blas[1],
        "unsymmetric": values.ndim == 2,
    }
    return _core.factor_panels(pattern, entries, values, inverse, lost, 1e8, threads)


def read_only(*shape):
    array = np.zeros(shape)
    array.flags.writeable = False
    return array
