"""What differs between dolfinx 0.5 and later; the only file that knows a version."""

from __future__ import annotations

import ctypes
import itertools
import platform
from collections.abc import Iterable
from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.algorithms.map_integrands import map_integrand_dags
from ufl.classes import ComponentTensor, FixedIndex, Identity, Indexed, IntValue, ListTensor, MultiIndex, Zero
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction

VERSION = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
CELLS = {2: "triangle", 3: "tetrahedron"}

FIRST_CONSTANT = 10**9

if VERSION >= (0, 8):
    import basix.ufl

# UFL orders the constants of a sum or product by the text of their running numbers, and there 10 comes before 9. With
# as many digits in all of them the order is that of their making, whatever this process has made before: one kernel,
# compiled once, and the same bits in every run.
if hasattr(ufl.Constant, "_globalcount"):
    ufl.Constant._globalcount = FIRST_CONSTANT
else:
    ufl.Constant._counter = itertools.count(FIRST_CONSTANT)


def read_settings() -> None:
    """Have dolfinx and FFCx look for their settings files, which each does once."""
    import dolfinx.jit

    if VERSION >= (0, 7):
        from ffcx.options import get_options

        dolfinx.jit.get_options(), get_options()
    else:
        from ffcx.parameters import get_parameters

        dolfinx.jit.get_parameters(), get_parameters()


def lagrange(dim: int, order: int, components: int | None = None) -> Any:
    """Continuous Lagrange element on simplices, scalar or with `components`."""
    if VERSION >= (0, 8):
        shape = () if components is None else (components,)
        return basix.ufl.element("Lagrange", CELLS[dim], order, shape=shape)
    if components is None:
        return ufl.FiniteElement("Lagrange", CELLS[dim], order)
    return ufl.VectorElement("Lagrange", CELLS[dim], order, dim=components)


def mixed(*elements: Any) -> Any:
    """Several elements side by side."""
    return basix.ufl.mixed_element(list(elements)) if VERSION >= (0, 8) else ufl.MixedElement(*elements)


def function_space(mesh: Any, element: Any) -> Any:
    """Function space of an element on a mesh."""
    return fem.functionspace(mesh, element) if VERSION >= (0, 7) else fem.FunctionSpace(mesh, element)


def _of_coordinates(dim: int) -> Any:
    """The element of a mesh's points; its variant said, which FFCx before 0.7 otherwise notes in it once it compiles a
    form: the forms that follow are other ones then, and no later process would find their kernels."""
    if VERSION >= (0, 8):
        return lagrange(dim, 1, dim)
    return ufl.VectorElement("Lagrange", CELLS[dim], 1, dim=dim, variant="equispaced")


def create_mesh(comm: Any, cells: np.ndarray, points: np.ndarray, dim: int) -> Any:
    """Distribute a simplex mesh, of which each rank has some rows of points and cells, without ghost cells."""
    domain = ufl.Mesh(_of_coordinates(dim))
    ghosts = dolfinx.mesh.GhostMode.none
    if VERSION < (0, 6):  # an array would be tried first, and refused with its text, 0.02 s
        table = dolfinx.cpp.graph.AdjacencyList_int64(np.asarray(cells, dtype=np.int64))
        return dolfinx.mesh.create_mesh(comm, table, points, domain, ghost_mode=ghosts)
    partitioner = dolfinx.mesh.create_cell_partitioner(ghosts)
    arguments = (domain, points) if VERSION >= (0, 10) else (points, domain)
    return dolfinx.mesh.create_mesh(comm, cells, *arguments, partitioner=partitioner)


def cell_dofs(dofmap: Any) -> np.ndarray:
    """All cell dofs of a dofmap (or geometry) as an array (cells, dofs per cell)."""
    table = dofmap.list if hasattr(dofmap, "list") else dofmap
    if hasattr(table, "array"):  # AdjacencyList
        return np.asarray(table.array).reshape(table.num_nodes, -1)
    return np.asarray(table)


def geometry_dofs(mesh: Any) -> np.ndarray:
    """Geometry nodes of every local cell (cells, dim + 1)."""
    return cell_dofs(mesh.geometry.dofmap)


def exterior_facets(mesh: Any) -> tuple[np.ndarray, np.ndarray]:
    """This rank's boundary facets (n,), ascending, and the points (n, dim) of the grid that are their corners."""
    topology = mesh.topology
    dim = topology.dim
    topology.create_connectivity(dim, 0)
    topology.create_connectivity(dim - 1, 0)
    facets = np.asarray(dolfinx.mesh.exterior_facet_indices(topology), dtype=np.int32)
    vertices = np.array([topology.connectivity(dim - 1, 0).links(facet) for facet in facets]).reshape(-1, dim)
    node = np.zeros(topology.index_map(0).size_local + topology.index_map(0).num_ghosts, dtype=np.int64)
    node[cell_dofs(topology.connectivity(dim, 0))] = geometry_dofs(mesh)
    return np.sort(facets), np.asarray(mesh.geometry.input_global_indices)[node[vertices[np.argsort(facets)]]]


def vector(function: Any) -> Any:
    """The PETSc vector behind a Function."""
    return function.x.petsc_vec if hasattr(function.x, "petsc_vec") else function.vector


def interpolation_points(element: Any) -> np.ndarray:
    """Reference points at which an Expression must be known to be interpolated."""
    points = element.interpolation_points
    return points() if callable(points) else points


def evaluate(expression: Any, mesh: Any, cells: np.ndarray) -> np.ndarray:
    """Values of an Expression at its points in each of the cells."""
    return np.asarray(expression.eval(cells) if VERSION < (0, 7) else expression.eval(mesh, cells))


class _Components(MultiFunction):
    """Components of tensors where it is known which: [a, b, 0][1] is b, and multiples of [a, b, 0][2] vanish."""

    expr = MultiFunction.reuse_if_untouched

    def indexed(self, expression: Any, tensor: Any, index: Any) -> Any:
        """The component itself."""
        first, *rest = index
        if isinstance(tensor, ListTensor) and isinstance(first, FixedIndex):
            row = tensor.ufl_operands[int(first)]
            return self.indexed(None, row, MultiIndex(tuple(rest))) if rest else row
        if isinstance(tensor, ComponentTensor) and any(isinstance(i, FixedIndex) for i in index):
            scalar, bound = tensor.ufl_operands
            chosen = map_expr_dag(_Bound(dict(zip(bound, index, strict=True))), scalar)
            return map_expr_dag(self, chosen)
        if isinstance(tensor, Identity) and all(isinstance(i, FixedIndex) for i in index):
            return IntValue(1) if len({int(i) for i in index}) == 1 else Zero()
        return Indexed(tensor, index) if expression is None else self.reuse_if_untouched(expression, tensor, index)

    def conditional(self, expression: Any, condition: Any, true: Any, false: Any) -> Any:
        """Zero where both branches are."""
        if isinstance(true, Zero) and isinstance(false, Zero):
            return true
        return self.reuse_if_untouched(expression, condition, true, false)


class _Bound(MultiFunction):
    """Free indices replaced by others."""

    expr = MultiFunction.reuse_if_untouched

    def __init__(self, chosen: dict[Any, Any]):
        super().__init__()
        self._chosen = chosen

    def multi_index(self, index: Any) -> Any:
        """The same indices, or those that stand for them."""
        return MultiIndex(tuple(self._chosen.get(i, i) for i in index))

    def zero(self, zero: Any) -> Any:
        """Zero without the indices that are bound now."""
        pairs = zip(zero.ufl_free_indices, zero.ufl_index_dimensions, strict=True)
        bound = {index.count() for index in self._chosen}
        left = [(count, dim) for count, dim in pairs if count not in bound]
        return Zero(zero.ufl_shape, tuple(c for c, _ in left), tuple(d for _, d in left))


def differentiated(form: Any) -> Any:
    """A form with its derivatives carried out, and no terms left that are zero because one field alone is varied.

    UFL before 2023 keeps them, and FFCx then cannot compile a kernel.
    """
    return map_integrand_dags(_Components(), apply_derivatives(apply_algebra_lowering(form)))


def interpolation_matrix(coarse: Any, fine: Any) -> Any:
    """The PETSc matrix that interpolates functions of a space in another one on the same mesh."""
    if VERSION >= (0, 8):
        matrix = fem_petsc.interpolation_matrix(coarse, fine)
    else:
        matrix = dolfinx.cpp.fem.petsc.interpolation_matrix(coarse._cpp_object, fine._cpp_object)
    matrix.assemble()
    return matrix


def create_vector(form: Any, space: Any) -> Any:
    """A ghosted PETSc vector that the form assembles into."""
    return fem_petsc.create_vector(space) if VERSION >= (0, 10) else fem_petsc.create_vector(form)


def quadrature(cell: str, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, dim) and weights (n,) of a rule on the reference `interval` or `triangle`."""
    import basix

    points, weights = basix.make_quadrature(getattr(basix.CellType, cell), degree)
    return np.asarray(points).reshape(len(weights), -1), np.asarray(weights)


def unused_options(prefix: str, names: Iterable[str]) -> list[str]:
    """Those PETSc options of a prefix that nothing has asked for so far (petsc4py does not tell before 3.19)."""
    library = ctypes.CDLL(PETSc.__file__)  # the extension resolves the symbols of the libpetsc it is linked to
    used = ctypes.c_int()
    unused = []
    for name in names:
        library.PetscOptionsUsed(None, f"{prefix}{name}".encode(), ctypes.byref(used))  # the name without its "-"
        if not used.value:
            unused.append(name)
    return unused


def versions() -> dict[str, str]:
    """Versions of the libraries that the numbers of a run depend on, gmsh's apart: it runs in a process of its own."""
    import petsc4py
    from mpi4py import MPI

    return {
        "python": platform.python_version(),
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
        "petsc4py": petsc4py.__version__,
        "numpy": np.__version__,
        "mpi": MPI.Get_library_version().split(",")[0].strip(),
    }
