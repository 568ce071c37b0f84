"""FMUs of frozen couplers, as FMPy finds, runs and compiles them."""

import ctypes
import json
import subprocess
import sys
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest
from frozen_couplers import frame, held

from pmalpha import rig

# the drift of the tie is that of both, and long steps show it
pytestmark = pytest.mark.filterwarnings("ignore:tied displacements:pmalpha.AccuracyWarning")
VERSIONS = ("2.0", "3.0")
INPUTS = {"column": ("specimen", "a", 1), "wind": ("force", "a", 2)}
OUTPUTS = {"roof.u": ("u", "a", 2), "shaft.a": ("a", "b", 1), "pull": ("multiplier", 0)}
UNITS = {"column": "N", "column.u": "m", "wind": "N", "roof.u": "m"}
STEPS = 40
# What one process does with an FMU, without this package: the rows of a run as JSON.
ALONE = """
import ctypes, json, sys
x = ctypes.CDLL(sys.argv[1])
token, resources, h, steps = sys.argv[2], sys.argv[3], float(sys.argv[4]), int(sys.argv[5])
f = x.fmi3InstantiateCoSimulation
f.restype = ctypes.c_void_p
c = ctypes.c_void_p(f(b"x", token.encode(), resources.encode(), False, False, False, False, None,
                      ctypes.c_size_t(0), None, None, None))
x.fmi3EnterInitializationMode(c, False, ctypes.c_double(), ctypes.c_double(), False,
                              ctypes.c_double())
x.fmi3ExitInitializationMode(c)
rows, r = [], (ctypes.c_uint32 * 4)(1, 2, 8, 10)
for k in range(steps):
    v = (ctypes.c_double * 4)()
    x.fmi3GetFloat64(c, r, ctypes.c_size_t(4), v, ctypes.c_size_t(4))
    rows.append(list(v))
    d = (ctypes.c_double * 1)(300.0 * v[0] + 50.0 * v[0] ** 3 + 0.1 * v[1])
    x.fmi3SetFloat64(c, (ctypes.c_uint32 * 1)(0), ctypes.c_size_t(1), d, ctypes.c_size_t(1))
    flags, t = [ctypes.c_bool() for _ in range(3)], ctypes.c_double()
    assert x.fmi3DoStep(c, ctypes.c_double(k * h), ctypes.c_double(h), False,
                        *map(ctypes.byref, flags), ctypes.byref(t)) == 0
assert "numpy" not in sys.modules and "pmalpha" not in sys.modules
print(json.dumps(rows))
"""


def specimen(d, v):
    return 300.0 * d + 50.0 * d**3 + 0.1 * v


def wind(t):
    return 4.0 * np.sin(11.0 * t)


def hybrid(wind=wind, commands=None):
    """commands: the list of the displacements and velocities at which the specimen is evaluated."""

    def restoring(u, v, t):
        if commands is not None:
            commands.append((u[1], v[1]))
        return np.array([0.0, specimen(u[1], v[1]), 0.0])

    return frame(
        "pm",
        "bilinear",
        restoring=restoring,
        force=lambda t: np.array([0.0, 0.0, wind(t)]),
    )


def outside(**rest):
    """The same with inputs in place of specimen and wind, to be exported."""
    restoring = rig.External([1], force=specimen(-0.02, 1.0))
    return frame("pm", "bilinear", restoring=restoring, **rest)


@pytest.fixture(scope="module")
def expected():
    """What a run records at the ends of macro steps."""
    coupler = hybrid()
    history = coupler.run(steps=STEPS)
    columns = history["a"].u[:, 2], history["b"].a[::3, 1], history.multipliers[::3, 0]
    return np.stack(columns, axis=1)


@pytest.fixture(scope="module", params=VERSIONS)
def path(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("fmu") / f"tower {request.param}.fmu"
    options = {"fmi": request.param, "license": "of the tower", "units": UNITS}
    outside().export_fmu(path, INPUTS, OUTPUTS, **options)
    return path


@pytest.fixture
def fmpy():
    return pytest.importorskip("fmpy")


class Instance:
    """An FMU by FMPy, with variables by name."""

    def __init__(self, fmpy, path, folder):
        description = fmpy.read_model_description(str(path))
        self.references = {x.name: x.valueReference for x in description.modelVariables}
        kinds = {"2.0": fmpy.fmi2.FMU2Slave, "3.0": fmpy.fmi3.FMU3Slave}
        self.is_2 = description.fmiVersion == "2.0"
        self.fmu = kinds[description.fmiVersion](
            guid=description.guid if self.is_2 else description.instantiationToken,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="one",
        )
        self.fmu.instantiate()
        self.begin()
        self.t = 0.0

    def begin(self):
        if self.is_2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.t = 0.0

    def get(self, *names):
        read = self.fmu.getReal if self.is_2 else self.fmu.getFloat64
        return list(read([self.references[name] for name in names]))

    def set(self, name, value):
        write = self.fmu.setReal if self.is_2 else self.fmu.setFloat64
        write([self.references[name]], [value])

    def step(self, h):
        self.fmu.doStep(currentCommunicationPoint=self.t, communicationStepSize=h)
        self.t += h

    def macro_step(self):
        """Three fine steps, in which specimen and wind are evaluated as in the run."""
        d, v = self.get("column.u", "column.v")
        self.set("column", specimen(d, v))
        self.set("wind", wind(0.02 * round(self.t / 0.02 + 1)))
        for _ in range(3):
            self.step(0.02 / 3)
        return self.get(*OUTPUTS)

    def run(self, steps=STEPS):
        return np.array([self.get(*OUTPUTS)] + [self.macro_step() for _ in range(steps)])

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()


@pytest.fixture
def unpacked(path, tmp_path):
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    return tmp_path


def test_fmpy_finds_no_problem(path, fmpy):
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(path)) == []


def test_variables_have_the_units_that_were_given(path, fmpy):
    description = fmpy.read_model_description(str(path))
    units = {x.name: x.unit for x in description.modelVariables if x.unit is not None}
    assert units == UNITS
    assert [x.name for x in description.unitDefinitions] == ["N", "m"]


@pytest.mark.parametrize(
    "units, error, message",
    [
        ({"roof": "m"}, ValueError, "units must have names of inputs and outputs, got 'roof'"),
        ({"wind": 1.0}, TypeError, "units must be a dict of texts"),
        (["m"], TypeError, "units must be a dict of texts"),
    ],
)
def test_units_of_what_is_not_there_are_refused(tmp_path, units, error, message):
    with pytest.raises(error, match=message):
        outside().export_fmu(tmp_path / "x.fmu", INPUTS, OUTPUTS, units=units)
    assert not list(tmp_path.iterdir())


def test_a_run_in_fmpy_is_that_of_the_coupler(path, unpacked, fmpy, expected):
    fmu = Instance(fmpy, path, unpacked)
    assert np.array_equal(fmu.run(), expected)
    fmu.fmu.reset()
    fmu.begin()
    assert np.array_equal(fmu.run(), expected)
    fmu.close()


def test_two_instances_and_states_that_go_from_one_to_the_other(path, unpacked, fmpy, expected):
    one, other = Instance(fmpy, path, unpacked), Instance(fmpy, path, unpacked)
    one.run(10)
    one.step(0.02 / 3)
    save, restore = (
        (one.fmu.getFMUstate, "setFMUstate") if one.is_2 else (one.fmu.getFMUState, "setFMUState")
    )
    state, t = save(), one.t
    rest = []
    for fmu in (one, other):
        getattr(fmu.fmu, restore)(state)
        fmu.t = t
        for _ in range(2):
            fmu.step(0.02 / 3)
        rest.append([fmu.get(*OUTPUTS)] + [fmu.macro_step() for _ in range(STEPS - 11)])
    assert np.array_equal(rest[0], rest[1])
    serialize = one.fmu.serializeFMUstate if one.is_2 else one.fmu.serializeFMUState
    made = other.fmu.deSerializeFMUstate if one.is_2 else other.fmu.deserializeFMUState
    again = made(serialize(state))
    getattr(other.fmu, restore)(again)
    other.t = t
    for _ in range(2):
        other.step(0.02 / 3)
    assert other.get(*OUTPUTS) == rest[0][0]
    one.close()
    other.close()


def test_a_part_of_a_step_is_refused(path, unpacked, fmpy):
    fmu = Instance(fmpy, path, unpacked)
    before = fmu.get(*OUTPUTS)
    with pytest.raises(Exception, match="status|failed"):
        fmu.step(0.37 * 0.02 / 3)
    assert fmu.get(*OUTPUTS) == before
    fmu.close()


def test_the_fmu_has_the_licences(unpacked):
    folder = unpacked / "documentation" / "licenses"
    assert "Redistribution" in (folder / "pmalpha.txt").read_text()
    assert (folder / "license.txt").read_text() == "of the tower"


def compiled(unpacked, output, *options):
    """The shared library of the sources of an FMU, as its description lists them."""
    sources = unpacked / "sources"
    description = ElementTree.parse(unpacked / "modelDescription.xml").getroot()
    if description.get("fmiVersion") == "3.0":
        description = ElementTree.parse(sources / "buildDescription.xml").getroot()
    names = [x.get("name") for x in description.iter() if x.tag in ("File", "SourceFile")]
    assert names
    subprocess.run(
        ["cc", "-std=gnu11", "-O2", "-march=native", "-w", "-shared", "-fPIC", "-I", "."]
        + [*options, *names, "-lm", "-pthread", "-o", str(output)],
        cwd=sources,
        check=True,
    )
    return output


@pytest.mark.gate
def test_the_sources_compile_and_give_the_same_numbers(path, unpacked, fmpy, expected):
    (binary,) = (unpacked / "binaries").glob("*/*")
    compiled(unpacked, binary)
    (unpacked / "resources" / "model.pma").unlink()
    fmu = Instance(fmpy, path, unpacked)
    assert np.array_equal(fmu.run(), expected)
    fmu.close()


@pytest.mark.gate
def test_names_have_the_prefix_of_the_command(path, unpacked, tmp_path):
    number = path.stem[-3]
    library = ctypes.CDLL(
        str(compiled(unpacked, tmp_path / "x.so", "-O0", f"-DFMI{number}_FUNCTION_PREFIX=tower_"))
    )
    assert hasattr(library, f"tower_fmi{number}DoStep")
    assert not hasattr(library, f"fmi{number}DoStep")


def test_a_process_without_python_packages_runs_it(tmp_path):
    """It sets no wind, and reads command, displacement of the roof and multiplier."""
    outside().export_fmu(tmp_path / "x.fmu", INPUTS, OUTPUTS, fmi="3.0")
    with zipfile.ZipFile(tmp_path / "x.fmu") as archive:
        archive.extractall(tmp_path)
    (binary,) = (tmp_path / "binaries").glob("*/*")
    token = ElementTree.parse(tmp_path / "modelDescription.xml").getroot().get("instantiationToken")
    run = subprocess.run(
        [
            sys.executable,
            "-I",
            "-S",
            "-c",
            ALONE,
            binary,
            token,
            f"{tmp_path}/resources/",
            str(0.02 / 3),
            "6",
        ],
        capture_output=True,
        text=True,
        check=True,
        env={},
    )
    commands = []
    history = hybrid(lambda t: 0.0, commands).run(steps=2)
    command = np.repeat(commands[-2:], 3, axis=0)  # the first is that of the start
    others = held(history["a"].u[:, 2], 6)[:6], held(history.multipliers[:, 0], 6)[:6]
    assert np.array_equal(json.loads(run.stdout), np.column_stack([command, *others]))


def test_no_compiler_is_needed_to_export(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    outside().export_fmu(tmp_path / "x.fmu", INPUTS, OUTPUTS)
    assert zipfile.is_zipfile(tmp_path / "x.fmu")


def test_an_unknown_version_is_refused_by_name(tmp_path):
    with pytest.raises(ValueError, match=r"fmi must be .*2\.0.*got '1\.0'"):
        outside().export_fmu(tmp_path / "x.fmu", INPUTS, OUTPUTS, fmi="1.0")
    assert not list(tmp_path.iterdir())
