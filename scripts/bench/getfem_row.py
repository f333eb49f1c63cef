#!/usr/bin/python3
"""Solves the axisymmetric HERTZ problem in GetFEM (Debian's python3-getfem).

usage: /usr/bin/python3 scripts/bench/getfem_row.py

The elements are quadratic triangles of size 0.01 under the tip on a mesh of gmsh. The contact has
nodal multipliers, and the load has ten steps. Prints the last force and the number of unknowns.
`scripts/make_start_page` runs this process alternating with configs/hertz.yaml.
"""

from __future__ import annotations

import math
import os
import tempfile

import getfem
import gmsh
import numpy as np

# Element sizes: up to the radius FINE_RADIUS they are H, beyond it they grow with the distance by
# GRADING up to LARGEST_H. The mesh has about as many unknowns as the row of peers.csv with 5231.
H = 0.01
FINE_RADIUS = 0.15
GRADING = 0.13
LARGEST_H = 0.1
DEPTH = 0.01
STEPS = 10
E = 1.0
NU = 0.3
R = 1.0
# Numbers of the boundaries.
BASE = 101
AXIS = 102
TOP = 103
VIRTUAL_WORK = (
    "(lame*(Trace(Grad_u) + u(1)/X(1))*(Trace(Grad_Test_u) + Test_u(1)/X(1))"
    " + 2*mu*(Sym(Grad_u):Sym(Grad_Test_u) + u(1)*Test_u(1)/sqr(X(1))))*X(1)"
)


def make_mesh() -> getfem.Mesh:
    """Return the half section of a cylinder of radius 1 and height 1, with its top at y = 0."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "half.msh")
        write_gmsh_file(path)
        mesh = getfem.Mesh("import", "gmsh", path)
    if mesh.dim() == 3:
        # gmsh writes three coordinates.
        mesh.transform([[1, 0, 0], [0, 1, 0]])
    faces = mesh.outer_faces()
    normals = mesh.normal_of_faces(faces)
    for region, direction in ((BASE, (0, -1)), (AXIS, (-1, 0)), (TOP, (0, 1))):
        mesh.set_region(region, faces[:, np.array(direction) @ normals > 0.9])
    return mesh


def write_gmsh_file(path: str) -> None:
    """Mesh the half section with gmsh and write it to a file."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
    for option in ("MeshSizeFromPoints", "MeshSizeFromCurvature", "MeshSizeExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    geometry = gmsh.model.geo
    corners = [geometry.addPoint(x, y, 0) for x, y in ((0, -1), (1, -1), (1, 0), (0, 0))]
    sides = [geometry.addLine(corners[k], corners[(k + 1) % 4]) for k in range(4)]
    surface = geometry.addPlaneSurface([geometry.addCurveLoop(sides)])
    geometry.synchronize()
    distance = f"(Sqrt(x^2+y^2)-{FINE_RADIUS})"
    size = f"({H}+{GRADING}*(0.5*({distance}+Abs{distance})))"
    formula = f"0.5*({size}+{LARGEST_H}-Abs({size}-{LARGEST_H}))"
    field = gmsh.model.mesh.field.add("MathEval")
    gmsh.model.mesh.field.setString(field, "F", formula)
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    gmsh.model.addPhysicalGroup(2, [surface], 1)
    gmsh.model.mesh.generate(2)
    gmsh.write(path)
    gmsh.finalize()


def main() -> None:
    """Solve the ten steps."""
    getfem.util_trace_level(0)
    mesh = make_mesh()
    space = getfem.MeshFem(mesh, 2)
    space.set_fem(getfem.Fem("FEM_PK(2,2)"))
    integration = getfem.MeshIm(mesh, getfem.Integ("IM_TRIANGLE(6)"))
    model = getfem.Model("real")
    model.add_fem_variable("u", space)
    model.add_initialized_data("lame", [E * NU / ((1 + NU) * (1 - 2 * NU))])
    model.add_initialized_data("mu", [E / (2 * (1 + NU))])
    model.add_linear_term(integration, VIRTUAL_WORK)
    model.add_Dirichlet_condition_with_simplification("u", BASE)
    model.add_normal_Dirichlet_condition_with_multipliers(integration, "u", 1, AXIS)
    top_dofs = space.basic_dof_on_region(TOP)
    vertical_dofs = top_dofs[1::2]
    count = len(vertical_dofs)
    x = space.basic_dof_nodes()[:, top_dofs][0, 1::2]
    selection = getfem.Spmat("empty", count, space.nbdof())
    selection.add(range(count), vertical_dofs, getfem.Spmat("identity", count))
    model.add_variable("push", count)
    model.add_initialized_data("r", [E / H])
    model.add_initialized_data("gap", x**2 / (2 * R))
    model.add_basic_contact_brick("u", "push", "r", selection, "gap")
    for step in range(1, STEPS + 1):
        model.set_variable("gap", x**2 / (2 * R) - DEPTH * step / STEPS)
        model.solve("max_iter", 100, "max_res", 1e-9, "lsolver", "mumps")
    force = -2 * math.pi * float(np.sum(model.variable("push")))
    print(f"force {force:.9g}, {space.nbdof()} unknowns")


if __name__ == "__main__":
    main()
