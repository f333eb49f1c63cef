"""The glossary: one name per thing, in YAML, Python and CSV alike, with its sign, meaning and dimension.

A word that means something else in one section has an entry under `section.word` as well.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Symbol:
    """One name: how it is written in formulas (LaTeX, may be empty), what it means, its dimension."""

    name: str
    latex: str
    meaning: str
    dimension: str


WORD = "word"  # the dimension of a choice, a text or a switch

SCENE = (
    Symbol("title", "", "what the scene is about; printed on pictures", WORD),
    Symbol("units", "", "units that numbers are meant in; one with a unit of its own is converted to them", WORD),
    Symbol("body", "", "the soft body: its shape and how it is held", WORD),
    Symbol("material", "", "the elastic law of the body, of its layers where they have none of their own", WORD),
    Symbol("indenter", "", "the rigid tip: an analytic surface, never meshed", WORD),
    Symbol("contact", "", "how contact is enforced", WORD),
    Symbol("loading", "", "the path of the tip: which depths are asked for", WORD),
    Symbol("experiment", "", "adhesion, relaxation and the instrument, computed from the solved curve", WORD),
    Symbol("mesh", "", "element sizes, and how much of the body is modelled", WORD),
    Symbol("accuracy", "", "largest relative error of the force at any step, which chooses the mesh; fast = 0.05, "
           "balanced = 0.01, accurate = 0.001", "1"),
    Symbol("solver", "", "how the equations are solved", WORD),
    Symbol("output", "", "what is written, and where", WORD),
    Symbol("units.length", "", "label of the length unit, for example mm", WORD),
    Symbol("units.force", "", "label of the force unit, for example N", WORD),
)  # fmt: skip

BODY = (
    Symbol("shape", "", "which body, or which tip; decides the other keys of its section", WORD),
    Symbol("radius", "r_0", "radius of the cylinder, of the ball, or of the flat punch", "length"),
    Symbol("height", "h", "thickness of the body; it occupies -height <= z <= 0", "length"),
    Symbol("width", "w", "width of the strip; it occupies 0 <= x <= width, in plane strain", "length"),
    Symbol("base_radius", "b", "radius of the flat side on which a cap stands", "length"),
    Symbol("contact_angle", r"\theta", "of a cap, between base and curved surface; instead of `height`", "degrees"),
    Symbol("size", "(l_x, l_y, l_z)", "edges of the box [0, l_x] x [0, l_y] x [-l_z, 0]", "length"),
    Symbol("base", "", "support of the lower face; roller: slides, does not lift; a ball's: docs/conventions.md", WORD),
    Symbol("sides", "", "support of the walls; roller: no normal displacement", WORD),
    Symbol("surfaces.contact", "", "name in the file of the surface that the tip may touch", WORD),
    Symbol("surfaces.base", "", "name in the file of the surface that `base` holds", WORD),
    Symbol("surfaces.sides", "", "name in the file of the surface that `sides` holds", WORD),
    Symbol("x_min", "", "support of the wall at x = 0", WORD),
    Symbol("x_max", "", "support of the wall at the largest x", WORD),
    Symbol("y_min", "", "support of the wall at y = 0", WORD),
    Symbol("y_max", "", "support of the wall at the largest y", WORD),
    Symbol("layers", "", "layers from the top, bonded to one another; their thicknesses add up to the height", WORD),
    Symbol("thickness", "", "thickness of a layer; the last one of a half_space, its substrate, has none", "length"),
    Symbol("layers.material", "", "the layer's material; without it the scene's", WORD),
    Symbol("inclusions", "", "pieces of other matter, each inside one layer and bonded to it", WORD),
    Symbol("inclusions.center", "", "middle of the inclusion, [x, y, z]; y = 0 in a strip", "length"),
    Symbol("inclusions.radius", "", "radius of the ball, or of the upright cylinder", "length"),
    Symbol("inclusions.height", "", "height of the upright cylinder", "length"),
    Symbol("inclusions.size", "", "edges of the box along x, y and z; in a strip it has no end along y", "length"),
    Symbol("inclusions.material", "", "the inclusion's material", WORD),
    Symbol("file", "", "mesh of the body, a .msh, .xdmf, .vtu or .inp file in the scene's folder or below", WORD),
    Symbol("kinematics", "", "what a mesh from a file is: a section of triangles, or a body of tetrahedra", WORD),
    Symbol(
        "surfaces",
        "",
        "what the file calls the surface that the tip may touch (`contact`), the `base`, and the `sides`; "
        "what has no name is free",
        WORD,
    ),
    Symbol("regions", "", "materials by what the file calls their cells; the others are of `material`", WORD),
    Symbol("hash", "", "fingerprint of the mesh that the file must hold; every result has that of its own", WORD),
)

MATERIAL = (
    Symbol("model", "", "the elastic law; decides the other keys of `material`", WORD),
    Symbol("E", "E", "Young's modulus", "pressure"),
    Symbol("nu", r"\nu", "Poisson's ratio", "1"),
    Symbol("E_z", "E_z", "Young's modulus along the axis z of a transversely isotropic material; E, nu: across it",
           "pressure"),
    Symbol("nu_z", r"\nu_z", "-eps_plane/eps_z under sigma_z, of a transversely isotropic material", "1"),
    Symbol("G_z", "G_z", "shear modulus of planes through the axis z of a transversely isotropic material", "pressure"),
    Symbol("mu", r"\mu", "shear modulus (never a friction coefficient)", "pressure"),
    Symbol("kappa", r"\kappa", "bulk modulus", "pressure"),
    Symbol("C10", "C_{10}", "first invariant's coefficient (Mooney-Rivlin, Yeoh)", "pressure"),
    Symbol("C01", "C_{01}", "second invariant's coefficient (Mooney-Rivlin)", "pressure"),
    Symbol("C20", "C_{20}", "coefficient of (I1 - 3)^2 (Yeoh)", "pressure"),
    Symbol("C30", "C_{30}", "coefficient of (I1 - 3)^3 (Yeoh)", "pressure"),
    Symbol("alpha", r"\alpha_i", "exponents of the stretches (Ogden)", "1"),
    Symbol("Jm", "J_m", "limit of I1 - 3 (Gent)", "1"),
    Symbol("lambda_m", r"\lambda_m", "limiting chain stretch (Arruda-Boyce)", "1"),
    Symbol("lame_lambda", r"\lambda", "first Lamé constant, kappa - 2 mu / 3", "pressure"),
    Symbol("formulation", "", "displacement alone, or mixed with a pressure for nu near 0.5", WORD),
    Symbol("E_star", "E^*", "plane-strain modulus E / (1 - nu^2)", "pressure"),
)

INDENTER = (
    Symbol("R", "R", "radius of the tip: of the ball, or of the paraboloid at its apex", "length"),
    Symbol("half_angle", r"\alpha", "angle between the axis and the flank (a pyramid: the face)", "degrees"),
    Symbol("tip_radius", r"\rho", "radius that rounds the apex (and a pyramid's edges, a profile's corners); 0: "
           "sharp", "length"),
    Symbol("faces", "", "number of faces of the pyramid, all alike", "1"),
    Symbol("rotation", "", "turn of the pyramid about z; at 0 one face's normal points along x", "degrees"),
    Symbol("points", "(r_i, z_i)", "the profile from the apex [0, 0] outward, [r, z] each, straight between", "length"),
    Symbol("edge_radius", r"\rho", "radius that rounds the edge of the flat punch; 0: sharp", "length"),
    Symbol("center", "(x_0, y_0)", "where the tip's axis meets the surface, [x, y] or for a strip [x]; default: axis "
           "of the cylinder, middle of the box or strip", "length"),
)  # fmt: skip

CONTACT = (
    Symbol("method", "", "which algorithm; auto: the program chooses and says why", WORD),
    Symbol("epsilon_n", r"\varepsilon_n", "contact stiffness of penalty, augmented Lagrangian and "
           "Uzawa", "pressure/length"),
    Symbol("gamma", r"\gamma", "stabilisation of Nitsche's method", "pressure/length"),
    Symbol("contact.gap", "", "reference: the gap is tested at the undeformed point, pressure along z; current: at "
           "the deformed point, pressure along the tip's normal; auto: reference at small strain", WORD),
    Symbol("lam", r"\lambda_n", "contact multiplier, a pressure >= 0", "pressure"),
    Symbol("p", "p", "normal contact pressure >= 0", "pressure"),
    Symbol("friction", "f", "Coulomb's friction coefficient, or stick: the surface never slips on the tip", "1"),
    Symbol("tau", r"\tau", "tangential traction on the body", "pressure"),
    Symbol("epsilon_t", r"\varepsilon_t", "tangential contact stiffness; auto: epsilon_n", "pressure/length"),
)  # fmt: skip

LOADING = (
    Symbol("delta", r"\delta", "indentation depth, > 0 pushes in", "length"),
    Symbol("loading.force", "F", "final force of the whole body, > 0 pushes; the depth is found", "force"),
    Symbol("steps", "", "number of equal steps to `delta` or `force`", "1"),
    Symbol("deltas", r"\delta_i", "the depths one by one instead of `delta`, unloading too; < 0: the tip is clear of "
           "the body", "length"),
    Symbol("forces", "F_i", "the forces one by one instead of `force`, unloading too; 0: the tip just touches, at "
           "delta = 0", "force"),
)  # fmt: skip

EXPERIMENT = (
    Symbol("adhesion", "", "attraction of tip and body: of a contact over a range, of an experiment without", WORD),
    Symbol("work", "w", "work of adhesion: the energy that separates a unit of area", "energy/length^2"),
    Symbol("range", "", "gap over which attraction falls by e; an experiment's for its Tabor number alone", "length"),
    Symbol("relaxation", "", "how the modulus falls with time, everywhere alike, nu being constant", WORD),
    Symbol("prony", r"[g_i, \tau_i]", "terms [fraction of the instantaneous modulus, time]; E(t) = E (1 - sum g_i (1 - "
           "exp(-t/tau_i)))", "1, time"),
    Symbol("power_law", "", "E(t) = E (t/time)^-exponent", WORD),
    Symbol("exponent", "b", "of the power law, between 0 (elastic) and 1 (a liquid)", "1"),
    Symbol("time", "t_0", "at which the power law's modulus is `material.E`", "time"),
    Symbol("history", "", "the way of the tip in time, [t, delta] each; with a cantilever or a frame [t, z]",
           "time, length"),
    Symbol("force_history", "", "the force in time, [t, force] each", "time, force"),
    Symbol("cantilever", "", "the spring that holds the tip", WORD),
    Symbol("frame", "", "what gives way beside the body", WORD),
    Symbol("cantilever.stiffness", "k", "spring constant of the cantilever; in plane strain per length, a pressure",
           "force/length"),
    Symbol("compliance", "c", "of the frame; in plane strain times length", "length/force"),
    Symbol("frequencies", "", "cycles per time of small oscillations about the end of the history: dynamic.csv",
           "1/time"),
    Symbol("calibration", "", "relative uncertainties of the instrument", WORD),
    Symbol("calibration.stiffness", "", "relative uncertainty of the cantilever's stiffness", "1"),
    Symbol("calibration.R", "", "relative uncertainty of the tip's radius", "1"),
    Symbol("t", "t", "time", "time"),
    Symbol("branch", "", "approach, hold or retract; of an equilibrium curve stable or unstable", WORD),
    Symbol("frequency", "", "cycles per time", "1/time"),
    Symbol("storage", "K'", "in-phase stiffness of the contact", "force/length"),
    Symbol("loss", "K''", "out-of-phase stiffness of the contact", "force/length"),
)  # fmt: skip

MESH = (
    Symbol("h_contact", "h", "element size under the tip; auto: at most 0.3 % force error at the last step", "length"),
    Symbol("h_axis", "", "element size at the tip's axis; from it sizes grow with the distance to h_contact where the "
           "deepest contact ends; without it a given h_contact is everywhere under the tip", "length"),
    Symbol("h_edge", "", "element size at the sharp edge of a flat punch; without it a fraction of "
           "h_contact", "length"),
    Symbol("h_corner", "", "element size at the corners of the section that the contact feels: where a fixed face "
           "meets a free one, and where it ends close to a side; without it a given h_contact has none of its own "
           "there", "length"),
    Symbol("h_inclusions", "", "element size inside each inclusion, in their order; without it by what the force feels "
           "of each", "length"),
    Symbol("grading", "", "growth of the element size per unit distance, outside the contact", "1"),
    Symbol("h_far", "h_\\infty", "largest element size, far from the tip", "length"),
    Symbol("order", "", "polynomial order of the displacement; linear elements (1) are gone", "1"),
    Symbol(
        "refinements",
        "",
        "how often every edge of a mesh from a file is halved; without it as often as `accuracy` needs, or never",
        "1",
    ),
    Symbol("symmetry", "", "which part is modelled; auto: the smallest the scene allows", WORD),
)  # fmt: skip

SOLVER = (
    Symbol(
        "solver.method",
        "",
        "how the scene is solved: by exact theory without a mesh, or on a mesh whose body is condensed to its surface "
        "or solved whole by Newton's method; auto: the program chooses and says why",
        WORD,
    ),
    Symbol("linear", "", "how linear systems are solved, by factorisation or iteratively; changes digits below 1e-8 "
           "alone", WORD),
    Symbol("rtol", "", "relative residual at which a step counts as converged; looser ones would fail the audit", "1"),
    Symbol("max_iterations", "", "most Newton iterations of one step", "1"),
    Symbol("petsc", "", "options for PETSc; one that it does not use, or that is not on the list, is an error", WORD),
)

OUTPUT = (
    Symbol("directory", "", "result folder, below the working directory; default: results/ and the name of the "
           "config", WORD),
    Symbol(
        "fields",
        "",
        "steps whose fields are written for ParaView; last: the deepest and the last; "
        "auto: last where a mesh is solved, none with theory",
        WORD,
    ),
    Symbol("surface", "", "state of the contact surface, point by point", WORD),
    Symbol("output.surface", "", "steps whose contact surface is written to surface.csv; last: the deepest and the "
           "last", WORD),
    Symbol("plot", "", "whether force_indentation.png is drawn", WORD),
)  # fmt: skip

RESULTS = (
    Symbol("step", "", "number of the requested depth, from 1", "1"),
    Symbol("force", "F", "> 0 pushing, of the whole body; per length in plane strain", "force"),
    Symbol("a", "a", "contact radius; half-width in plane strain; sqrt(area/pi) in 3D", "length"),
    Symbol("p_max", r"p_{\max}", "largest contact pressure; nominal with gap reference, else true; empty where it is "
           "infinite", "pressure"),
    Symbol("penetration", "", "how deep the tip is inside the body at the worst contact point", "length"),
    Symbol("energy", r"\Pi", "strain energy plus penalty energy of the whole body", "energy"),
    Symbol("stiffness", r"\mathrm{d}F/\mathrm{d}\delta", "of the load curve at this row", "force/length"),
    Symbol("area", "", "contact area, pi a^2; in plane strain its width, 2 a", "area"),
    Symbol("E_hertz", "", "modulus that the half-space formula of the same tip reads off this one row; empty where "
           "there is none", "pressure"),
    Symbol("newton_iterations", "", "linear solves of the step, those of its substeps included", "1"),
    Symbol("krylov_iterations", "", "iterations of these linear solves, where they are iterative", "1"),
    Symbol("wall_s", "", "wall time since the start of the run", "s"),
    Symbol("stick_radius", "", "sqrt(area/pi) of the part of the contact that does not slip on the tip; half its width "
           "in plane strain; with friction", "length"),
    Symbol("dissipation", "", "what friction turned into heat since the row before; with friction", "energy"),
    Symbol("side_force_x", "", "force on the tip along x; with friction, where no mirror plane stands across", "force"),
    Symbol("side_force_y", "", "force on the tip along y, as side_force_x", "force"),
    Symbol("force_error", "", "half-width of the error bar on the force", "force"),
    Symbol("a_error", "", "half-width of the error bar on the contact radius", "length"),
    Symbol("p_max_error", "", "half-width of the error bar on the largest pressure", "pressure"),
    Symbol("delta_error", "", "half-width of the error bar on a depth that is found for a force", "length"),
    Symbol("reaction", "", "z-reaction of all constrained degrees of freedom; equals the force", "force"),
    Symbol("overlap", "", "how deep a whole surface facet lies inside the tip's own shape; current gap", "length"),
    Symbol("stray_reaction", "", "reaction of the constraints that only remove rigid modes; zero", "force"),
    Symbol("substeps", "", "how many solves the step was cut into", "1"),
    Symbol("converged", "", "whether the step has a solution", WORD),
    Symbol("reason", "", "why a step has no solution", WORD),
)  # fmt: skip

STUDY = (
    Symbol("study.base", "", "the scene that is varied: the path of its file, or the scene itself", WORD),
    Symbol("set", "", "keys and values that hold for every run", WORD),
    Symbol("vary", "", "keys and the values they take: lists or ranges, crossed or zipped", WORD),
    Symbol("zip", "", "which keys go together value by value: true, or a list of them", WORD),
    Symbol("compare_to", "", "what force, a and p_max are compared with: theory, finest, a force, a result", WORD),
    Symbol("tolerance", "", "error of the force that is still right: every row gets a verdict, refused scenes a "
           "row", "1"),
    Symbol("from", "", "first number of a range", "that of the key"),
    Symbol("to", "", "last number of a range", "that of the key"),
    Symbol("count", "", "how many numbers a range has, both ends included", "1"),
    Symbol("spacing", "", "linear: equal distances; log: equal factors", WORD),
    Symbol("unit", "", "E*/h_contact: the numbers of the range are multiples of it, on each mesh its own", WORD),
)  # fmt: skip

STUDY_TABLE = (
    Symbol("index", "", "number of the row, from 1, in the order of the grid", "1"),
    Symbol("run", "", "name of the run's folder: equal physics has equal names and is solved once", WORD),
    Symbol("status", "", "done, failed, or pending when the study was stopped before", WORD),
    Symbol("exit_code", "", "what `indent-sim run` of this row would end with", "1"),
    Symbol("steps_done", "", "requested depths that were reached", "1"),
    Symbol("force_error_vs", "", "force / reference - 1 at the last depth; out of contact force / largest force", "1"),
    Symbol("force_error_worst", "", "largest |force / reference - 1| at any depth of the path", "1"),
    Symbol("a_error_vs", "", "a / reference - 1 at the last depth", "1"),
    Symbol("p_error_vs", "", "p_max / reference - 1 at the last depth", "1"),
    Symbol("study.stiffness", "", "epsilon_n or gamma of the method in E*/h_contact", "1"),
    Symbol("dofs", "", "unknowns of the finite-element model", "1"),
    Symbol("cpu_resolve", "", "CPU seconds until everything is decided", "s"),
    Symbol("cpu_companions", "", "CPU seconds of the coarser meshes behind error bars, where there are any", "s"),
    Symbol("cpu_mesh", "", "CPU seconds of the mesh", "s"),
    Symbol("cpu_assemble", "", "CPU seconds of forms, matrices and factorisation", "s"),
    Symbol("cpu_solve", "", "CPU seconds of all load steps", "s"),
    Symbol("cpu_write", "", "CPU seconds of writing results", "s"),
    Symbol("cpu_s", "", "CPU seconds of the run; loading the libraries is left out", "s"),
    Symbol("stated_error", "", "relative error of the force that the run itself warns of or measures", "1"),
    Symbol("warnings", "", "what the run warns of", WORD),
    Symbol("verdict", "", "right, flagged, refused, wrong or reference; only with a tolerance", WORD),
    Symbol("memory_MB", "", "memory the run needed beyond what its process held before", "MB"),
    Symbol("peak_memory_MB", "", "largest memory of the process during the run, and of the one that meshes", "MB"),
)

SURFACE = (
    Symbol("x", "x", "undeformed position along x; along the radius in an axisymmetric scene", "length"),
    Symbol("y", "y", "undeformed position along y; 0 in a scene with two dimensions", "length"),
    Symbol("u", "u", "displacement", "length"),
    Symbol("z", "z", "height of the undeformed point, 0 on a flat top; in experiment.csv the way of the cantilever's "
           "base, delta + force/k + c force", "length"),
    Symbol("u_x", "u_x", "displacement along x; along the radius in an axisymmetric scene", "length"),
    Symbol("u_y", "u_y", "displacement along y", "length"),
    Symbol("u_z", "u_z", "displacement along z, < 0 under the tip", "length"),
    Symbol("gap", "g", "distance of the body from the tip, >= 0 open", "length"),
    Symbol("pressure", "p", "contact pressure >= 0", "pressure"),
    Symbol("shear", r"\tau", "tangential traction on the body, > 0 along x or the radius; its size where there are "
           "three dimensions; with friction", "pressure"),
)

CONTINUUM = (
    Symbol("H", "H", "displacement gradient", "1"),
    Symbol("F", "F", "deformation gradient I + H", "1"),
    Symbol("C", "C", "right Cauchy-Green tensor F^T F", "1"),
    Symbol("J", "J", "volume ratio det F", "1"),
    Symbol("P", "P", "first Piola-Kirchhoff stress", "pressure"),
    Symbol("S", "S", "second Piola-Kirchhoff stress", "pressure"),
    Symbol("sigma", r"\sigma", "Cauchy stress", "pressure"),
    Symbol("psi", r"\psi", "strain energy per undeformed volume", "pressure"),
    Symbol("v", "v", "virtual displacement", "length"),
    Symbol("n", "n", "outward normal", "1"),
)

PULL_OFF = (
    Symbol("maugis_pull_off", "", "pull-off by Maugis-Dugdale on a half-space", "force"),
    Symbol("jkr_pull_off", "", "pull-off without range (JKR)", "force"),
)

ADHERENCE = (
    Symbol("cohesive_zone", "", "cohesive zone", "length"),
    Symbol("elements", "", "elements in the cohesive zone", "1"),
    Symbol("tabor", "", "Tabor number", "1"),
    Symbol("maugis_lambda", r"\lambda", "Maugis' lambda", "1"),
    *PULL_OFF,
)

GROUPS = {
    "Scene": SCENE,
    "Body": BODY,
    "Material": MATERIAL,
    "Indenter": INDENTER,
    "Contact": CONTACT,
    "Loading": LOADING,
    "Experiment": EXPERIMENT,
    "Mesh": MESH,
    "Solver": SOLVER,
    "Output": OUTPUT,
    "Results, one row a step": RESULTS,
    "What is known of an attraction over a range": ADHERENCE,
    "Studies": STUDY,
    "Table of a study, one row a run": STUDY_TABLE,
    "Contact surface": SURFACE,
    "Continuum mechanics": CONTINUUM,
}
SYMBOLS = {symbol.name: symbol for group in GROUPS.values() for symbol in group}


def lookup(name: str, section: str = "") -> Symbol | None:
    """The entry of a name, the section's own before the general one; None when it has none."""
    return SYMBOLS.get(f"{section}.{name}") or SYMBOLS.get(name)


def _formula(latex: str) -> str:
    return f"${latex}$" if latex else ""


def symbols_markdown() -> str:
    """docs/symbols.md."""
    parts = [
        "# Symbols\n\nGenerated from `indent_sim/model/symbols.py` by `python -m indent_sim.config.reference`.\n",
        "One name per thing, in YAML, Python and CSV alike. z is up, the undeformed surface is z = 0.\n",
    ]
    for title, group in GROUPS.items():
        rows = [f"| `{s.name}` | {_formula(s.latex)} | {s.meaning} | {s.dimension} |" for s in group]
        head = ["| name | symbol | meaning | dimension |", "|---|---|---|---|"]
        parts.append("\n".join([f"## {title}\n", *head, *rows]) + "\n")
    return "\n".join(parts)
