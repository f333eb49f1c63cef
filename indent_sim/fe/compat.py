"""Compatibility with dolfinx 0.5 and later: the only module that depends on its version."""

from __future__ import annotations

import itertools
import platform
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import basix
import dolfinx
import numpy as np
import petsc4py
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from dolfinx.mesh import Mesh
from mpi4py import MPI
from petsc4py import PETSc
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.algorithms.map_integrands import map_integrand_dags
from ufl.classes import (
    ComponentTensor,
    Expr,
    FixedIndex,
    Identity,
    Index,
    Indexed,
    ListTensor,
    MultiIndex,
)
from ufl.constantvalue import IntValue, Zero
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction

DOLFINX_VERSION = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
CELL_NAMES = {2: "triangle", 3: "tetrahedron"}
# PETSc 3.25 renames this reason
_REASONS = PETSc.SNES.ConvergedReason
SNES_RESIDUAL_NOT_FINITE = (
    getattr(_REASONS, "DIVERGED_FUNCTION_NANORINF", None) or _REASONS.DIVERGED_FNORM_NAN
)
# An element of Basix or of UFL, by version
Element = Any

if DOLFINX_VERSION >= (0, 8):
    import basix.ufl

# UFL sorts the constants of a sum or product by their numbers as text; 10 then precedes 9. If all
# numbers have the same number of digits, the order is that of their creation, whatever the process
# has created before. Each kernel is then compiled only once, and all runs are bit-equal.
# dolfinx.fem.Constant cannot be given a number; https://github.com/FEniCS/dolfinx/issues/2074 is
# about the same dependence on the order of creation.
FIRST_CONSTANT_NUMBER = 10**9
if hasattr(ufl.Constant, "_globalcount"):
    ufl.Constant._globalcount = FIRST_CONSTANT_NUMBER
else:
    ufl.Constant._counter = itertools.count(FIRST_CONSTANT_NUMBER)


@cache
def kernel_folder() -> Path:
    """Return the program's own folder for compiled kernels, a subfolder of dolfinx's cache.

    Each version of Python has a separate folder. The first call reads the settings of dolfinx and
    FFCx.
    """
    name = "options" if DOLFINX_VERSION >= (0, 6) else "parameters"
    settings = getattr(dolfinx.jit, f"get_{name}")()
    getattr(import_module(f"ffcx.{name}"), f"get_{name}")()
    folder = f"indent-sim-{sys.implementation.cache_tag}"
    return Path(str(settings["cache_dir"])).expanduser() / folder


def jit_options() -> dict[str, dict[str, str]]:
    """Return the keyword argument that makes dolfinx compile into the program's kernel folder."""
    keyword = "jit_options" if DOLFINX_VERSION >= (0, 6) else "jit_params"
    return {keyword: {"cache_dir": str(kernel_folder())}}


def lagrange_element(dim: int, order: int, components: int = 1) -> Element:
    """Continuous Lagrange element of a given order on simplices, scalar or vector-valued."""
    if DOLFINX_VERSION >= (0, 8):
        return basix.ufl.element(
            "Lagrange", CELL_NAMES[dim], order, shape=(components,) if components > 1 else ()
        )
    if components > 1:
        return ufl.VectorElement("Lagrange", CELL_NAMES[dim], order, dim=components)
    return ufl.FiniteElement("Lagrange", CELL_NAMES[dim], order)


def quadrature_element(dim: int, degree: int, components: int) -> Element:
    """Vector-valued quadrature element (values at quadrature points) on simplices."""
    if DOLFINX_VERSION >= (0, 8):
        return basix.ufl.quadrature_element(
            CELL_NAMES[dim], value_shape=(components,), degree=degree
        )
    return ufl.VectorElement(
        "Quadrature", CELL_NAMES[dim], degree, dim=components, quad_scheme="default"
    )


def cellwise_element(dim: int, components: int) -> Element:
    """Piecewise constant vector-valued element (one vector in each cell)."""
    if DOLFINX_VERSION >= (0, 8):
        return basix.ufl.element("DG", CELL_NAMES[dim], 0, shape=(components,))
    return ufl.VectorElement("DG", CELL_NAMES[dim], 0, dim=components)


def mixed_element(*elements: Element) -> Element:
    """Mixed element that combines several elements."""
    return (
        basix.ufl.mixed_element(list(elements))
        if DOLFINX_VERSION >= (0, 8)
        else ufl.MixedElement(*elements)
    )


def function_space(mesh: Mesh, element: Element) -> fem.FunctionSpace:
    """Function space of an element on a mesh."""
    if DOLFINX_VERSION >= (0, 10):
        return fem.functionspace(mesh, element)
    if DOLFINX_VERSION >= (0, 7):
        return fem.functionspace(mesh, element, **jit_options())
    return fem.FunctionSpace(mesh, element, **jit_options())


def _coordinate_element(dim: int, order: int) -> Element:
    """Vector-valued Lagrange element of the mesh coordinates.

    FFCx before 0.7 sets the variant of the element when it compiles the first kernel, which would
    change the names of later kernels. This function therefore sets the variant before.
    """
    if DOLFINX_VERSION >= (0, 8):
        return lagrange_element(dim, order, dim)
    return ufl.VectorElement("Lagrange", CELL_NAMES[dim], order, dim=dim, variant="equispaced")


def create_mesh(comm: MPI.Comm, cells: np.ndarray, points: np.ndarray, dim: int) -> Mesh:
    """Create a distributed simplex mesh without ghost cells (collective).

    Parameters
    ----------
    comm : MPI.Comm
        Communicator.
    cells : ndarray of int, (n, corners) or (n, corners + edges)
        This rank's share of the cells: numbers of their corners. For quadratic triangles (dim 2)
        the numbers of the edge midpoints follow, of which the k-th one is opposite to corner k.
    points : ndarray, (m, dim)
        This rank's share of the points [length].
    dim : int
        Dimension.
    """
    domain = ufl.Mesh(_coordinate_element(dim, 1 if cells.shape[1] == dim + 1 else 2))
    ghosts = dolfinx.mesh.GhostMode.none
    if DOLFINX_VERSION < (0, 6):
        return dolfinx.mesh.create_mesh(comm, cells, points, domain, ghost_mode=ghosts)
    # The largest number of cells at a facet
    limits = (2,) if DOLFINX_VERSION >= (0, 11) else ()
    partitioner = dolfinx.mesh.create_cell_partitioner(ghosts, *limits)
    arguments = (domain, points) if DOLFINX_VERSION >= (0, 10) else (points, domain)
    return dolfinx.mesh.create_mesh(comm, cells, *arguments, partitioner=partitioner)


def zero_bc(dofs: np.ndarray, space: fem.FunctionSpace) -> fem.DirichletBC:
    """Homogeneous Dirichlet condition on given dofs of a function space."""
    return fem.dirichletbc(PETSc.ScalarType(0), dofs.astype(np.int32), space)


def cell_dofs(dofmap: Any) -> np.ndarray:
    """Return the dofs of each cell as an array (cells, dofs per cell).

    `dofmap` is the dofmap of a function space, or of a mesh's geometry, whose dofs are its nodes.
    """
    table = dofmap.list if hasattr(dofmap, "list") else dofmap
    if hasattr(table, "array"):  # an AdjacencyList
        return np.asarray(table.array).reshape(table.num_nodes, -1)
    return np.asarray(table)


def geometry_dofs(mesh: Mesh) -> np.ndarray:
    """Return the geometry nodes (cells, dim + 1) at the corners of every local cell."""
    geometry = mesh.geometry
    dofmap = geometry.dofmaps[0] if DOLFINX_VERSION >= (0, 11) else geometry.dofmap
    return cell_dofs(dofmap)[:, : mesh.topology.dim + 1]


def has_vertex_dofs(space: fem.FunctionSpace) -> bool:
    """Return whether the element of a space has dofs at the corners of its cells."""
    return len(space.dofmap.dof_layout.entity_dofs(0, 0)) > 0


def exterior_facets(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return this rank's boundary facets (n,), ascending, and the grid points (n, dim) of each."""
    topology = mesh.topology
    dim = topology.dim
    topology.create_connectivity(dim, 0)
    topology.create_connectivity(dim - 1, 0)
    facets = np.asarray(dolfinx.mesh.exterior_facet_indices(topology), dtype=np.int32)
    vertices = np.array(
        [topology.connectivity(dim - 1, 0).links(facet) for facet in facets]
    ).reshape(-1, dim)
    node = np.zeros(
        topology.index_map(0).size_local + topology.index_map(0).num_ghosts, dtype=np.int64
    )
    node[cell_dofs(topology.connectivity(dim, 0))] = geometry_dofs(mesh)
    return np.sort(facets), np.asarray(mesh.geometry.input_global_indices)[
        node[vertices[np.argsort(facets)]]
    ]


def petsc_vector(function: fem.Function) -> PETSc.Vec:
    """Return the PETSc vector that stores the dof values of a function."""
    return function.x.petsc_vec if hasattr(function.x, "petsc_vec") else function.vector


def evaluate_expression(expression: fem.Expression, mesh: Mesh, cells: np.ndarray) -> np.ndarray:
    """Evaluate an Expression at its own points in the given cells; return (cells, values)."""
    return np.asarray(
        expression.eval(cells) if DOLFINX_VERSION < (0, 7) else expression.eval(mesh, cells)
    )


class _ComponentSimplifier(MultiFunction):
    """UFL transformation that evaluates components of list tensors, e.g. [a, b, 0][1] = b."""

    expr = MultiFunction.reuse_if_untouched

    def indexed(self, expression: Expr, tensor: Expr, index: Expr) -> Expr:
        """Simplify the indexing of a list tensor, component tensor or identity to its component."""
        first, *rest = index
        if isinstance(tensor, ListTensor) and isinstance(first, FixedIndex):
            row = tensor.ufl_operands[int(first)]
            return self.indexed(None, row, MultiIndex(tuple(rest))) if rest else row
        if isinstance(tensor, ComponentTensor) and any(isinstance(i, FixedIndex) for i in index):
            scalar, bound = tensor.ufl_operands
            chosen = map_expr_dag(_IndexReplacement(dict(zip(bound, index, strict=True))), scalar)
            return map_expr_dag(self, chosen)
        if isinstance(tensor, Identity) and all(isinstance(i, FixedIndex) for i in index):
            return IntValue(1) if len({int(i) for i in index}) == 1 else Zero()
        return (
            Indexed(tensor, index)
            if expression is None
            else self.reuse_if_untouched(expression, tensor, index)
        )

    def conditional(self, expression: Expr, condition: Expr, true: Expr, false: Expr) -> Expr:
        """Simplify a conditional expression to zero if both of its branches are zero."""
        if isinstance(true, Zero) and isinstance(false, Zero):
            return true
        return self.reuse_if_untouched(expression, condition, true, false)


class _IndexReplacement(MultiFunction):
    """UFL transformation that substitutes free indices of an expression."""

    expr = MultiFunction.reuse_if_untouched

    def __init__(self, replacements: dict[Index, Index]):
        super().__init__()
        self._replacements = replacements

    def multi_index(self, index: MultiIndex) -> MultiIndex:
        """Return the multi-index after the substitution of its free indices."""
        return MultiIndex(tuple(self._replacements.get(i, i) for i in index))

    def zero(self, zero: Zero) -> Zero:
        """Return a zero that no longer has the replaced indices as free indices."""
        pairs = zip(zero.ufl_free_indices, zero.ufl_index_dimensions, strict=True)
        bound = {index.count() for index in self._replacements}
        remaining = [(count, dim) for count, dim in pairs if count not in bound]
        return Zero(zero.ufl_shape, tuple(c for c, _ in remaining), tuple(d for _, d in remaining))


def expand_derivatives(form: ufl.Form) -> ufl.Form:
    """Evaluate the derivatives of a form, and remove terms that are zero.

    Terms vanish if only one field is varied. UFL before 2023 keeps them, and FFCx then cannot
    compile a kernel.
    """
    return map_integrand_dags(
        _ComponentSimplifier(), apply_derivatives(apply_algebra_lowering(form))
    )


def interpolation_matrix(coarse: fem.FunctionSpace, fine: fem.FunctionSpace) -> PETSc.Mat:
    """Return the matrix that interpolates from a coarse into a fine space on the same mesh."""
    if DOLFINX_VERSION >= (0, 8):
        matrix = fem_petsc.interpolation_matrix(coarse, fine)
    else:
        # https://github.com/FEniCS/dolfinx/issues/3022 asked for a function without private names.
        matrix = dolfinx.cpp.fem.petsc.interpolation_matrix(coarse._cpp_object, fine._cpp_object)
    matrix.assemble()
    return matrix


def create_vector(form: fem.Form, space: fem.FunctionSpace) -> PETSc.Vec:
    """Create a ghosted PETSc vector for the assembly of a linear form on a function space."""
    return (
        fem_petsc.create_vector(space)
        if DOLFINX_VERSION >= (0, 10)
        else fem_petsc.create_vector(form)
    )


def quadrature_rule(cell: str, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points (n, dim) and weights (n,) of the quadrature rule on a named reference cell."""
    points, weights = basix.make_quadrature(getattr(basix.CellType, cell), degree)
    return np.asarray(points).reshape(len(weights), -1), np.asarray(weights)


def versions() -> dict[str, str]:
    """Return the versions, by name, of the libraries on which the results of a run depend.

    The version of gmsh is not among them, because gmsh runs in another process.
    """
    petsc = ".".join(map(str, PETSc.Sys.getVersion()))
    mpi = MPI.Get_library_version().split(",")[0].strip()
    modules = {"dolfinx": dolfinx, "petsc4py": petsc4py, "numpy": np}
    module_versions = {name: module.__version__ for name, module in modules.items()}
    return {"python": platform.python_version(), "petsc": petsc, "mpi": mpi, **module_versions}
