"""A coupler as an FMU for co-simulation (FMI 2.0), made by PythonFMU.

The tower of the README on its rig: two subdomains with different steps, which the program that
imports the FMU sees as one. `python examples/coupler_fmu.py` writes TowerOnRig.fmu. Whoever
simulates it needs a Python with pmalpha; docs/other-programs.md has the rest.
"""

import struct
from pathlib import Path
from tempfile import TemporaryDirectory

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, FmuBuilder, Real
from tower_on_rig import DT, tower_on_rig

from pmalpha import PmalphaError


class TowerOnRig(Fmi2Slave):
    """Force on the roof in, motion of the roof and force between the subdomains out."""

    description = "A soft implicit tower on a stiff explicit rig"
    default_experiment = DefaultExperiment(start_time=0.0, stop_time=20.0, step_size=DT)

    def __init__(self, **arguments):
        super().__init__(**arguments)
        self.force = 0.0  # during the coming communication step
        self.coupler = tower_on_rig(lambda t: self.force)
        self.register_variable(Real("force", causality=Fmi2Causality.input, start=0.0))
        for name, value in (
            ("displacement", lambda: self.coupler.state("tower").u[2]),
            ("velocity", lambda: self.coupler.state("tower").v[2]),
            ("multiplier", lambda: self.coupler.multipliers[0]),
        ):
            self.register_variable(Real(name, causality=Fmi2Causality.output, getter=value))

    def exit_initialization_mode(self):
        """The initial accelerations are those of the input that has been set by now."""
        self.coupler.reset()

    def do_step(self, current_time, step_size):
        """Macro steps up to the end of the communication step; False where it has no such end."""
        steps = round(step_size / DT)
        if steps < 1 or abs(steps - step_size / DT) > 1e-6:
            self.log(f"step_size must be a whole number of macro steps of {DT}, got {step_size}")
            return False
        try:
            self.coupler.step(steps)
        except (PmalphaError, ValueError) as error:  # the state is that of the last macro step
            self.log(f"{type(error).__name__}: {error}")
            return False
        return True

    # what fmi2GetFMUstate, fmi2SetFMUstate and their serialization by PythonFMU call

    def _get_fmu_state(self):
        coupler = self.coupler
        return {"force": self.force, "coupler": coupler, "snapshot": coupler.snapshot()}

    def _set_fmu_state(self, state):
        self.force = state["force"]
        if "checkpoint" in state:  # it was serialized
            with TemporaryDirectory() as folder:
                path = Path(folder, "state.npz")
                path.write_bytes(state["checkpoint"])
                self.coupler.load(path)
        else:
            self.coupler.restore(state["snapshot"])

    @staticmethod
    def _fmu_state_to_bytes(state):
        """The input and a checkpoint, for which the coupler returns to the state for a moment."""
        if "checkpoint" in state:
            return struct.pack("<d", state["force"]) + state["checkpoint"]
        coupler = state["coupler"]
        present = coupler.snapshot()
        with TemporaryDirectory() as folder:
            path = Path(folder, "state.npz")
            try:
                coupler.restore(state["snapshot"])
                coupler.save(path)
            finally:
                coupler.restore(present)
            return struct.pack("<d", state["force"]) + path.read_bytes()

    @staticmethod
    def _fmu_state_from_bytes(data):
        return {"force": struct.unpack("<d", data[:8])[0], "checkpoint": data[8:]}


def build(folder="."):
    """Write TowerOnRig.fmu; returns its path."""
    here = Path(__file__)
    return FmuBuilder.build_FMU(
        here,
        dest=folder,
        project_files=[here.with_name("tower_on_rig.py")],
        canGetAndSetFMUstate=True,
        canSerializeFMUstate=True,
    )


if __name__ == "__main__":
    print(build())
