"""Names, places and shapes of the arrays in fields/, and the files that hold them."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from indent_sim.results.atomic_files import read_regular_file

# XDMF's center ("Node" or "Cell") and attribute type of an array, and the shape of one value.
ArrayLayout = tuple[str, str, tuple[int, ...]]
ArrayLayouts = dict[str, ArrayLayout]
TIP_ARRAYS: ArrayLayouts = {"displacement": ("Node", "Vector", (3,))}
ARRAYS: ArrayLayouts = TIP_ARRAYS | {
    "pressure": ("Node", "Scalar", ()),
    "stress": ("Cell", "Tensor", (9,)),
    "von_mises": ("Cell", "Scalar", ()),
    "principal_stresses": ("Cell", "Vector", (3,)),
    "J": ("Cell", "Scalar", ()),
    "energy_density": ("Cell", "Scalar", ()),
}
# Arrays of some bodies only: shear traction (with friction), pore pressure and fluid content (with
# fluid in the pores), swelling (gels), plastic strain (bodies that yield), and stresses at the
# nodes (if requested).
OPTIONAL_ARRAYS: ArrayLayouts = {
    "shear": ("Node", "Scalar", ()),
    "pore_pressure": ("Node", "Scalar", ()),
    "fluid_content": ("Cell", "Scalar", ()),
    "swelling": ("Cell", "Scalar", ()),
    "plastic_strain": ("Cell", "Scalar", ()),
    "nodal_stress": ("Node", "Tensor", (9,)),
    "nodal_von_mises": ("Node", "Scalar", ()),
}
# These arrays are stored once, in the file of the mesh.
MESH_ARRAYS: ArrayLayouts = {"region": ("Cell", "Scalar", ())}
XDMF_FILE = "fields.xdmf"
FIELDS_MESH_FILE = "mesh.h5"
GRID_PATTERN = re.compile(
    r'<Grid Name="step (?P<step>\d{1,9})".*?<Time Value="(?P<time>[^"]*)".*?'
    r'Name="delta" Value="(?P<delta>[^"]*)".*?</Grid>\n',
    re.DOTALL,
)
XDMF_TAIL = "</Grid>\n</Domain>\n</Xdmf>\n"


def vectors_in_3d(vectors: np.ndarray) -> np.ndarray:
    """Return (n, 2) vectors of the (x, z) plane as (n, 3); (n, 3) vectors are unchanged."""
    vectors = np.asarray(vectors, dtype=float)
    if vectors.shape[1] == 3:
        return vectors
    return np.column_stack([vectors[:, 0], np.zeros(len(vectors)), vectors[:, 1]])


def step_file(step: int) -> str:
    """Return the name of the HDF5 file of a step."""
    return f"step-{step}.h5"


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an HDF5 file by name; a damaged file can raise any exception."""
    import h5py

    with h5py.File(io.BytesIO(read_regular_file(path)), "r") as file:
        return {name: values[()] for name, values in file.items()}
