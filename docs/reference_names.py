"""What the reference leaves out, and the pages that explain its names."""

import pmalpha

# what classes have for the program's own use, which the reference leaves out
SPRING = "has_memory initial_tangent largest_tangent law moves numbers"
ACTUATOR = "dofs facts innermost needs_acceleration needs_measured springs width compensates leads"
INTERNAL = {
    **dict.fromkeys("CubicSpring Gap Bilinear BoucWen RambergOsgood".split(), SPRING),
    "Multilinear": "has_memory initial_tangent largest_tangent moves numbers",
    "Subdomain": "has_feedback has_functions has_symmetric_steps implicit_damping iterates springs"
    " implicit_stiffness initial_tangent largest_tangent massless restoring_springs is_linear",
    "BaseAcceleration": "hold",
    "SampledForce": "hold",
    "History": "contact_gaps contact_impulses contact_layout",
    "Misfit": "record",
    "Parameters": "name",
    "rig.Compensated": ACTUATOR,
    "rig.LinearActuator": f"{ACTUATOR} transfer",
    "rig.Linkage": ACTUATOR,
    "rig.SimulatedActuator": ACTUATOR,
    "structures.Structure": "recipe",
}

# where names of the reference are explained: the pages of a name, or of all names of a module
ERRORS = [name for name in pmalpha.__all__ if name.endswith(("Error", "Warning"))]
LAWS = "CubicSpring Gap Bilinear BoucWen RambergOsgood Multilinear DiscreteGradient".split()
EXPLAINED = {
    "Subdomain": "tutorial own-element units",
    "GeneralizedAlpha": "tutorial choosing",
    "SampledForce": "model units",
    "BaseAcceleration": "tutorial units",
    "MovingLoad": "moving",
    "InternalForce": "own-element elements",
    **dict.fromkeys(LAWS, "own-element rig"),
    "Coupler": "tutorial right choosing diverges runs rig",
    "Newton": "couplings diverges",
    **dict.fromkeys(("tie", "solve"), "tutorial"),
    **dict.fromkeys(("Constraint", "tie_coincident", "reduce"), "model"),
    **dict.fromkeys(("cut", "Cut", "Elements"), "model"),
    **dict.fromkeys(("contact", "Contact", "contact_coincident", "interpolate"), "contact"),
    **dict.fromkeys(("History", "SubdomainHistory"), "tutorial runs"),
    "Goal": "budget",
    **dict.fromkeys(("Misfit", "Parameters", "element_parameters"), "gradients"),
    "Study": "many",
    "analysis": "tutorial stability model",
    "readers": "other-programs units",
    "rig": "rig",
    "structures": "model elements",
    **dict.fromkeys(ERRORS, "diverges"),
}
