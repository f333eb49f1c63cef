#!/usr/bin/python3
"""HERTZ, axisymmetric, by GetFEM (Debian's python3-getfem): one process, as a run of this program is one.

usage: /usr/bin/python3 scripts/bench/getfem_row.py

Quadratic triangles of 0.01 under the tip, nodal multipliers, ten steps; the mesh is gmsh's. Prints the last force and
the unknowns. `scripts/make_start_page` runs it in turns with configs/hertz.yaml.
"""

from __future__ import annotations

import math
import os
import tempfile

import getfem
import gmsh
import numpy as np

H, NEAR, GRADING, LARGEST = (
    0.01,
    0.15,
    0.13,
    0.1,
)  # lengths; about the 5231 unknowns of the row in peers.csv
DEPTH, STEPS, E, NU, R = 0.01, 10, 1.0, 0.3, 1.0
BASE, AXIS, TOP = 101, 102, 103  # boundaries
ELASTIC = (
    "(lame*(Trace(Grad_u) + u(1)/X(1))*(Trace(Grad_Test_u) + Test_u(1)/X(1))"
    " + 2*mu*(Sym(Grad_u):Sym(Grad_Test_u) + u(1)*Test_u(1)/sqr(X(1))))*X(1)"
)


def mesh() -> getfem.Mesh:
    """The half section of a cylinder of radius 1 and height 1, its top at y = 0."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
    for switch in ("MeshSizeFromPoints", "MeshSizeFromCurvature", "MeshSizeExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.{switch}", 0)
    corners = [gmsh.model.geo.addPoint(x, y, 0) for x, y in ((0, -1), (1, -1), (1, 0), (0, 0))]
    sides = [gmsh.model.geo.addLine(corners[k], corners[(k + 1) % 4]) for k in range(4)]
    surface = gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(sides)])
    gmsh.model.geo.synchronize()
    field = gmsh.model.mesh.field.add("MathEval")
    beyond = f"(0.5*((Sqrt(x^2+y^2)-{NEAR})+Abs(Sqrt(x^2+y^2)-{NEAR})))"
    size = f"({H}+{GRADING}*{beyond})"
    gmsh.model.mesh.field.setString(field, "F", f"0.5*({size}+{LARGEST}-Abs({size}-{LARGEST}))")
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    gmsh.model.addPhysicalGroup(2, [surface], 1)
    gmsh.model.mesh.generate(2)
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "half.msh")
        gmsh.write(path)
        gmsh.finalize()
        made = getfem.Mesh("import", "gmsh", path)
    if made.dim() == 3:  # gmsh writes the third coordinate
        made.transform([[1, 0, 0], [0, 1, 0]])
    faces = made.outer_faces()
    normals = made.normal_of_faces(faces)
    for region, direction in ((BASE, (0, -1)), (AXIS, (-1, 0)), (TOP, (0, 1))):
        made.set_region(region, faces[:, np.array(direction) @ normals > 0.9])
    return made


def main() -> None:
    """Solve the ten steps."""
    getfem.util_trace_level(0)
    body = mesh()
    space = getfem.MeshFem(body, 2)
    space.set_fem(getfem.Fem("FEM_PK(2,2)"))
    rule = getfem.MeshIm(body, getfem.Integ("IM_TRIANGLE(6)"))
    model = getfem.Model("real")
    model.add_fem_variable("u", space)
    model.add_initialized_data("lame", [E * NU / ((1 + NU) * (1 - 2 * NU))])
    model.add_initialized_data("mu", [E / (2 * (1 + NU))])
    model.add_linear_term(rule, ELASTIC)
    model.add_Dirichlet_condition_with_simplification("u", BASE)
    model.add_normal_Dirichlet_condition_with_multipliers(rule, "u", 1, AXIS)
    top = space.basic_dof_on_region(TOP)
    nodes = space.basic_dof_nodes()[:, top]
    upward = top[1::2]
    x = nodes[0, 1::2]
    choose = getfem.Spmat("empty", len(upward), space.nbdof())
    choose.add(range(len(upward)), upward, getfem.Spmat("identity", len(upward)))
    model.add_variable("push", len(upward))
    model.add_initialized_data("r", [E / H])
    model.add_initialized_data("gap", x**2 / (2 * R))
    model.add_basic_contact_brick("u", "push", "r", choose, "gap")
    for step in range(1, STEPS + 1):
        model.set_variable("gap", x**2 / (2 * R) - DEPTH * step / STEPS)
        model.solve("max_iter", 100, "max_res", 1e-9, "lsolver", "mumps")
    force = -2 * math.pi * float(np.sum(model.variable("push")))
    print(f"force {force:.9g}, {space.nbdof()} unknowns")


if __name__ == "__main__":
    main()
