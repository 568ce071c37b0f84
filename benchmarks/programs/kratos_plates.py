"""The two plates of plate.py in Kratos, run by the interpreter that has it.

Reads a JSON object from the standard input and writes one, in a line of its own, with the seconds
of a macro step, the least of many, and the displacements of B after the given macro steps. The
coupling is feti_dynamic_coupled_solver of the CoSimulationApplication.
"""

import json
import sys
import time

import KratosMultiphysics as KM
import KratosMultiphysics.CoSimulationApplication.co_simulation_tools as tools
import KratosMultiphysics.StructuralMechanicsApplication as SM
from KratosMultiphysics.CoSimulationApplication.co_simulation_analysis import CoSimulationAnalysis

# The fastest that is in the wheels, for both plates' equations and for the multipliers: conjugate
# gradients, which converge to rounding. Direct solvers factor the matrix anew in each step.
SOLVER = {"solver_type": "LinearSolversApplication.sparse_cg"}


def plate_settings(dt, method, scheme):
    return {
        "type": "solver_wrappers.kratos.structural_mechanics_wrapper",
        "solver_wrapper_settings": {
            "problem_data": {
                "problem_name": "plate",
                "parallel_type": "OpenMP",
                "echo_level": 0,
                "start_time": 0.0,
                "end_time": 1e9,
            },
            "solver_settings": {
                "solver_type": "Dynamic",
                "time_integration_method": method,
                "scheme_type": scheme,
                "model_part_name": "Structure",
                "domain_size": 2,
                "analysis_type": "linear",
                "move_mesh_flag": False,
                "compute_reactions": False,
                "model_import_settings": {"input_type": "use_input_model_part"},
                "time_stepping": {"time_step": dt},
                "linear_solver_settings": SOLVER,
            },
        },
    }


def settings(dt, substeps):
    mapper = {
        "mapper_type": "coupling_geometry",
        "precompute_mapping_matrix": True,
        "modeler_name": "MappingGeometriesModeler",
        "modeler_parameters": {
            "origin_model_part_name": "origin",
            "destination_model_part_name": "destination",
            "is_interface_sub_model_parts_specified": True,
            "origin_interface_sub_model_part_name": "Structure.face",
            "destination_interface_sub_model_part_name": "Structure.face",
        },
    }
    no_data = {"input_data_list": [], "output_data_list": []}
    return {
        "problem_data": {
            "start_time": 0.0,
            "end_time": 1e9,
            "echo_level": 0,
            "parallel_type": "OpenMP",
        },
        "solver_settings": {
            "type": "coupled_solvers.feti_dynamic_coupled_solver",
            "origin_newmark_beta": 0.25,
            "origin_newmark_gamma": 0.5,
            "destination_newmark_beta": 0.0,
            "destination_newmark_gamma": 0.5,
            "equilibrium_variable": "VELOCITY",
            "is_linear": True,
            "echo_level": 0,
            "linear_solver_settings": SOLVER,
            "data_transfer_operators": {
                "mapper": {"type": "kratos_mapping", "mapper_settings": mapper}
            },
            "coupling_sequence": [{"name": "A", **no_data}, {"name": "B", **no_data}],
            "solvers": {
                "A": plate_settings(dt, "implicit", "newmark"),
                "B": plate_settings(dt / substeps, "explicit", "central_differences"),
            },
        },
    }


def fill(part, q, x, column):
    """Mesh and material of a plate with its lower left corner at x, and the face at a column."""
    nx, ny, h = q["nx"], q["ny"], q["h"]
    nodes = [[i * (ny + 1) + j + 1 for j in range(ny + 1)] for i in range(nx + 1)]
    for i, ids in enumerate(nodes):
        for j, node in enumerate(ids):
            part.CreateNewNode(node, x + i * h, j * h, 0.0)
    properties = part.CreateNewProperties(1)
    properties[KM.YOUNG_MODULUS] = q["E"]
    properties[KM.POISSON_RATIO] = q["nu"]
    properties[KM.DENSITY] = q["rho"]
    properties[KM.THICKNESS] = 1.0
    properties[KM.CONSTITUTIVE_LAW] = SM.LinearElasticPlaneStress2DLaw()
    for i in range(nx):
        for j in range(ny):
            corners = [nodes[i][j], nodes[i + 1][j], nodes[i + 1][j + 1], nodes[i][j + 1]]
            part.CreateNewElement("SmallDisplacementElement2D4N", corners[0], corners, properties)
    face = part.CreateSubModelPart("face")
    face.AddNodes(nodes[column])
    for j in range(ny):
        ends = nodes[column][j : j + 2]
        face.CreateNewCondition("LineLoadCondition2D2N", j + 1, ends, properties)
    return nodes, properties


def coupled(q):
    """The analysis at t = 0: A clamped at its left edge, B loaded along its lower edge."""
    analysis = CoSimulationAnalysis(KM.Parameters(json.dumps(settings(q["dt"], q["substeps"]))))
    plates = analysis._GetSolver().solver_wrappers
    a, b = plates["A"].model["Structure"], plates["B"].model["Structure"]
    nx, ny = q["nx"], q["ny"]
    nodes, _ = fill(a, q, 0.0, -1)
    _, properties = fill(b, q, nx * q["h"], 0)
    for i in range(nx):
        ends = [nodes[i][0], nodes[i + 1][0]]
        loaded = b.CreateNewCondition("LineLoadCondition2D2N", ny + 1 + i, ends, properties)
        loaded.SetValue(SM.LINE_LOAD, KM.Array3([0.5**0.5, 0.5**0.5, 0.0]))
    analysis.Initialize()
    for node in nodes[0]:
        a.Nodes[node].Fix(KM.DISPLACEMENT_X)
        a.Nodes[node].Fix(KM.DISPLACEMENT_Y)
    # the matrix of A is assembled once
    plates["A"]._analysis_stage._GetSolver()._GetSolutionStrategy().SetRebuildLevel(0)
    return analysis, b


def fine_steps(analysis, count):
    """The loop of an analysis of Kratos, RunSolutionLoop."""
    solver = analysis._GetSolver()
    for _ in range(count):
        analysis.time = solver.AdvanceInTime(analysis.time)
        analysis.InitializeSolutionStep()
        solver.Predict()
        solver.SolveSolutionStep()
        analysis.FinalizeSolutionStep()
        analysis.OutputSolutionStep()


def main():
    q = json.load(sys.stdin)
    KM.Logger.GetDefaultOutput().SetSeverity(KM.Logger.Severity.WARNING)
    KM.ParallelUtilities.SetNumThreads(1)
    tools.cs_print_info = lambda *words: None  # a line each step
    analysis, b = coupled(q)
    fine_steps(analysis, q["substeps"] * q["steps"])
    u = [
        node.GetSolutionStepValue(component)
        for node in b.Nodes
        for component in (KM.DISPLACEMENT_X, KM.DISPLACEMENT_Y)
    ]
    least, done, start = float("inf"), 0, time.perf_counter()
    while done < 3 or time.perf_counter() - start < q["seconds"]:
        begin = time.thread_time()
        fine_steps(analysis, q["substeps"])
        least = min(least, time.thread_time() - begin)
        done += 1
    print("\n" + json.dumps({"seconds": least, "u": u}), flush=True)


if __name__ == "__main__":
    main()
