"""FMUs of frozen couplers, as FMPy finds, runs and compiles them."""

import ctypes
import json
import subprocess
import sys
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest
from fmus import Instance
from frozen_couplers import frame, held

import pmalpha as pm
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

    def restoring(t, u, v):
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


class Hybrid(Instance):
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


@pytest.fixture
def unpacked(path, tmp_path):
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    return tmp_path


def test_fmpy_finds_no_problem(path, fmpy):
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(path)) == []


@pytest.mark.gate
def test_variables_have_the_units_that_were_given(path, fmpy):
    description = fmpy.read_model_description(str(path))
    units = {x.name: x.unit for x in description.modelVariables if x.unit is not None}
    assert units == UNITS
    assert [x.name for x in description.unitDefinitions] == ["N", "m"]


@pytest.mark.parametrize(
    "units, error, message",
    [
        ({"roof": "m"}, ValueError, "units must have names of inputs and outputs, got 'roof'"),
        ({"wind": "N\x01"}, ValueError, r"units must be words that can be printed, got 'N\\x01'"),
        ({"wind": 1.0}, TypeError, "units must be a dict of texts"),
        (["m"], TypeError, "units must be a dict of texts"),
    ],
)
def test_units_of_what_is_not_there_are_refused(tmp_path, units, error, message):
    with pytest.raises(error, match=message):
        outside().export_fmu(tmp_path / "x.fmu", INPUTS, OUTPUTS, units=units)
    assert not list(tmp_path.iterdir())


def test_a_run_in_fmpy_is_that_of_the_coupler(path, unpacked, fmpy, expected):
    fmu = Hybrid(fmpy, path, unpacked)
    assert np.array_equal(fmu.run(), expected)
    fmu.fmu.reset()
    fmu.begin()
    assert np.array_equal(fmu.run(), expected)
    fmu.close()


def test_two_instances_and_states_that_go_from_one_to_the_other(path, unpacked, fmpy, expected):
    one, other = Hybrid(fmpy, path, unpacked), Hybrid(fmpy, path, unpacked)
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


@pytest.mark.gate
def test_a_part_of_a_step_is_refused(path, unpacked, fmpy):
    fmu = Hybrid(fmpy, path, unpacked)
    before = fmu.get(*OUTPUTS)
    with pytest.raises(Exception, match="status|failed"):
        fmu.step(0.37 * 0.02 / 3)
    assert fmu.get(*OUTPUTS) == before
    fmu.close()


# ---- what masters rely on ----------------------------------------------------------------------


def oscillator(dt=0.01, *, force=None, frozen_at=0):
    """A mass of 2 with a spring of 50, from rest, which may have run for some steps."""
    s = pm.Subdomain([2.0], [50.0], scheme=pm.Newmark(), force=force, name="s", dof_names=["top"])
    coupler = pm.Coupler([s], dt=dt)
    coupler.step(frozen_at)
    return coupler


class Own(Instance):
    """An FMU of an oscillator, in a folder of its own."""

    def __init__(self, fmpy, coupler, folder, fmi, inputs=None, start=0.0, values=None):
        path = folder / f"{len(list(folder.iterdir()))}.fmu"
        coupler.export_fmu(path, inputs, {"u": ("u", "s", 0), "a": ("a", "s", 0)}, fmi=fmi)
        with zipfile.ZipFile(path) as archive:
            archive.extractall(path.with_suffix(""))
        self.start, self.start_values = start, values or {}
        super().__init__(fmpy, path, path.with_suffix(""))

    def begin(self):
        if self.is_2:
            self.fmu.setupExperiment(startTime=self.start)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=self.start)
        for name, value in self.start_values.items():
            self.set(name, value)
        self.fmu.exitInitializationMode()
        self.t = self.start


def is_refused(call, *arguments, **options):
    try:
        call(*arguments, **options)
    except Exception as error:  # of FMPy, of no class of its own
        return "status" in str(error) or "failed" in str(error)
    return False


@pytest.mark.parametrize("fmi", VERSIONS)
def test_the_start_time_of_the_master_is_that_of_the_model(tmp_path, fmpy, fmi):
    with pytest.raises(Exception, match="status|failed"):
        Own(fmpy, oscillator(), tmp_path, fmi, start=2.0)
    coupler = oscillator(force=[1.0], frozen_at=100)
    fmu = Own(fmpy, coupler, tmp_path, fmi, start=1.0)
    (path,) = (x for x in tmp_path.glob("*.fmu") if x.stem == "2")
    description = fmpy.read_model_description(str(path))
    assert float(description.defaultExperiment.startTime) == 1.0
    assert "t = 1.0" in description.description and "0.01" in description.description
    assert not description.coSimulation.canHandleVariableCommunicationStepSize
    history = coupler.run(steps=3)
    for k in range(3):
        fmu.step(0.01)
        assert fmu.get("u")[0] == history["s"].u[k + 1, 0]
    fmu.close()


@pytest.mark.gate
@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_step_from_another_time_or_before_the_initialization_is_an_error(tmp_path, fmpy, fmi):
    fmu = Own(fmpy, oscillator(force=[1.0]), tmp_path, fmi)
    fmu.step(0.01)
    before = fmu.get("u", "a")
    for point in (0.0, 0.02, 77.0):
        assert is_refused(
            fmu.fmu.doStep, currentCommunicationPoint=point, communicationStepSize=0.01
        )
    assert fmu.get("u", "a") == before
    fmu.fmu.reset()
    assert is_refused(fmu.fmu.doStep, currentCommunicationPoint=0.0, communicationStepSize=0.01)
    assert is_refused(fmu.fmu.exitInitializationMode)
    fmu.begin()
    fmu.step(0.01)
    assert fmu.get("u", "a") == before
    fmu.fmu.terminate()
    assert is_refused(fmu.fmu.doStep, currentCommunicationPoint=0.01, communicationStepSize=0.01)
    fmu.fmu.freeInstance()


PUSH = {"push": ("force", "s", 0)}


@pytest.mark.parametrize("fmi", VERSIONS)
def test_inputs_of_the_initialization_are_in_the_initial_accelerations(tmp_path, fmpy, fmi):
    fmu = Own(fmpy, oscillator(), tmp_path, fmi, PUSH, values={"push": 3.0})
    assert fmu.get("a") == [1.5]
    steps = [fmu.get("u")[0]]
    for _ in range(20):
        fmu.step(0.01)
        steps += fmu.get("u")
    expected = oscillator(force=[3.0]).run(steps=20)["s"].u[:, 0]
    assert np.allclose(steps, expected, rtol=0.0, atol=1e-15)  # 1.5 = 3 / 2, in both
    fmu.close()


@pytest.mark.gate
def test_a_velocity_at_the_start_that_the_structure_has_not_ends_no_initialization(tmp_path, fmpy):
    s = pm.Subdomain([2.0, 1.0], [50.0, 10.0], scheme=pm.Newmark(), name="s")
    coupler = pm.Coupler([s], pm.Constraint({s: [[1.0, 0.0]]}, velocity=[0.0]), dt=0.01)
    inputs = {"table": ("velocity", 0)}
    fmu = Own(fmpy, coupler, tmp_path, "2.0", inputs)
    fmu.fmu.reset()
    fmu.fmu.enterInitializationMode()
    fmu.set("table", 0.1)
    assert is_refused(fmu.fmu.exitInitializationMode)
    assert is_refused(fmu.fmu.exitInitializationMode)
    fmu.set("table", 0.0)
    fmu.fmu.exitInitializationMode()
    fmu.fmu.terminate()
    fmu.fmu.freeInstance()


def errors(fmpy, tmp_path, *, slopes):
    """Of the motion under cos(7 t), with its values at communication points, for two steps."""

    def force(t):
        return 3.0 * np.cos(7.0 * t)

    found = []
    for dt in (0.02, 0.01):
        fmu = Own(fmpy, oscillator(dt), tmp_path, "2.0", PUSH, values={"push": 3.0})
        motion = fmu.get("u")
        for k in range(round(1.0 / dt)):
            fmu.set("push", force(k * dt))
            if slopes:
                slope = -21.0 * np.sin(7.0 * k * dt)
                fmu.fmu.setRealInputDerivatives([fmu.references["push"]], [1], [slope])
            fmu.step(dt)
            motion += fmu.get("u")
        t = dt * np.arange(len(motion))
        exact = 1.5 * (np.cos(5.0 * t) - np.cos(7.0 * t)) / (7.0**2 - 5.0**2)
        found.append(np.max(np.abs(motion - exact)))
        fmu.close()
    return found


def test_slopes_of_inputs_give_the_order_of_the_scheme(tmp_path, fmpy):
    coarse, fine = errors(fmpy, tmp_path, slopes=False)
    assert 1.7 < coarse / fine < 2.3  # what is held is late by a step: order 1
    coarse_2, fine_2 = errors(fmpy, tmp_path, slopes=True)
    assert 3.5 < coarse_2 / fine_2 < 4.5 and fine_2 < 0.2 * fine  # order 2


def test_a_communication_step_of_several_steps_follows_the_slope(tmp_path, fmpy):
    fmu = Own(fmpy, oscillator(), tmp_path, "2.0", PUSH)
    reference = fmu.references["push"]
    assert is_refused(fmu.fmu.setRealInputDerivatives, [reference], [2], [1.0])
    assert is_refused(fmu.fmu.setRealInputDerivatives, [fmu.references["u"]], [1], [1.0])
    fmu.set("push", 0.0)
    fmu.fmu.setRealInputDerivatives([reference], [1], [4.0])
    state = fmu.fmu.getFMUstate()
    fmu.step(0.05)
    expected = oscillator(force=lambda t: [4.0 * t]).run(steps=5)["s"].u[-1]
    assert np.allclose(fmu.get("u"), expected, rtol=1e-14, atol=0.0)  # products in another order
    assert fmu.get("push") == [0.2]  # and is held there
    fmu.fmu.setFMUstate(state)
    fmu.t = 0.0
    fmu.step(0.05)
    assert np.allclose(fmu.get("u"), expected, rtol=1e-14, atol=0.0)
    fmu.close()


def test_descriptions_name_the_subdomain_and_the_dof(path, fmpy):
    texts = {x.name: x.description for x in fmpy.read_model_description(str(path)).modelVariables}
    assert "external force on dof 2 of a" in texts["wind"]
    assert texts["column.u"] == "displacement of the next command of dof 1 of a"
    assert texts["roof.u"] == "displacement of dof 2 of a"
    assert texts["shaft.a"] == "acceleration of dof 1 of b"
    assert texts["pull"] == "multiplier of row 0 of the constraints"


@pytest.mark.parametrize("fmi", VERSIONS)
def test_names_that_an_fmu_has_already_are_refused(tmp_path, fmi):
    for outputs, message in (
        ({"time": ("u", "a", 0)}, "other names than 'time'"),
        ({"column.u": ("u", "a", 0)}, "the commands of its specimens, got 'column.u'"),
    ):
        with pytest.raises(ValueError, match=message):
            outside().export_fmu(tmp_path / "x.fmu", INPUTS, outputs, fmi=fmi)
        assert not list(tmp_path.iterdir())


@pytest.mark.gate
def test_an_instance_without_a_name_is_made(path, unpacked):
    if path.stem[-3] == "3":
        pytest.skip("a name is not used there")
    (binary,) = (unpacked / "binaries").glob("*/*")
    guid = ElementTree.parse(unpacked / "modelDescription.xml").getroot().get("guid")
    library = ctypes.CDLL(str(binary))
    library.fmi2Instantiate.restype = ctypes.c_void_p
    uri = f"file://{unpacked}/resources".encode()
    made = library.fmi2Instantiate(None, 1, guid.encode(), uri, None, 0, 0)
    assert made
    library.fmi2FreeInstance(ctypes.c_void_p(made))


@pytest.mark.gate
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
    fmu = Hybrid(fmpy, path, unpacked)
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


@pytest.mark.gate
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
