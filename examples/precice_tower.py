"""A coupler as a participant of preCICE 3, with snapshots as its checkpoints.

The tower of the README on its rig is one participant, a spring from its roof to the ground the
other. In two terminals:

    python examples/precice_tower.py Tower examples/precice_implicit.xml
    python examples/precice_tower.py Spring examples/precice_implicit.xml

With precice_explicit.xml the force of the spring is that of the window before.
docs/bindings.md has the results.
"""

import sys

from tower_on_rig import DT, ROOF, tower_on_rig

SPRING = 2.0


def tower(participant):
    """Runs until the end of the coupling; the roof's displacements at the ends of time windows."""
    mesh, force = "Tower-Mesh", 0.0
    coupler = tower_on_rig(lambda t: force)
    vertices = participant.set_mesh_vertices(mesh, [[0.0, 0.0]])
    if participant.requires_initial_data():
        participant.write_data(mesh, "Displacement", vertices, [ROOF])
    participant.initialize()
    force = participant.read_data(mesh, "Force", vertices, 0.0)[0]
    coupler.reset()  # whose initial accelerations are those of this force
    roof = [ROOF]
    while participant.is_coupling_ongoing():
        if participant.requires_writing_checkpoint():
            present = coupler.snapshot()
        left = participant.get_max_time_step_size()
        if left < (1.0 - 1e-6) * DT:
            raise ValueError(f"time windows must be whole numbers of {DT}, {left:g} is left of one")
        step = min(DT, left)  # equal but for rounding
        force = participant.read_data(mesh, "Force", vertices, step)[0]
        coupler.step()
        u = coupler.state("tower").u[2]
        participant.write_data(mesh, "Displacement", vertices, [u])
        participant.advance(step)
        if participant.requires_reading_checkpoint():
            coupler.restore(present)
        elif participant.is_time_window_complete():
            roof.append(u)
    participant.finalize()
    return roof


def spring(participant):
    """The other participant, which keeps no state and so has nothing to store in a checkpoint."""
    mesh = "Spring-Mesh"
    vertices = participant.set_mesh_vertices(mesh, [[0.0, 0.0]])
    if participant.requires_initial_data():
        participant.write_data(mesh, "Force", vertices, [-SPRING * ROOF])
    participant.initialize()
    while participant.is_coupling_ongoing():
        participant.requires_writing_checkpoint()
        step = participant.get_max_time_step_size()
        u = participant.read_data(mesh, "Displacement", vertices, step)
        participant.write_data(mesh, "Force", vertices, -SPRING * u)
        participant.advance(step)
        participant.requires_reading_checkpoint()
    participant.finalize()


def main(name, configuration):
    import precice

    participant = precice.Participant(name, configuration, 0, 1)
    if name == "Spring":
        spring(participant)
    else:
        print(*(x.hex() for x in tower(participant)))


if __name__ == "__main__":
    main(*sys.argv[1:])
