"""Random hostile mesh files: valid files of every kind with wrong contents, and bombs.

Each is at most 10 MB long. Arrays are changed before they are written, bytes after that. Bombs are
small files that ask for much time or memory.
"""

from __future__ import annotations

import random
import re
import zlib
from base64 import b64encode
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
from mesh_files import block, section, write

MOST_BYTES = 10_000_000  # a test may have it smaller
NUMBERS = [
    b"nan",
    b"inf",
    b"-1",
    b"0",
    b"1e999",
    b"1e308",
    b"999999999999",
    b"4294967297",
    b"2147483648",
    b"-2147483649",
    b"18446744073709551615",
    b"1.5",
    b"1_0",
    b"0x10",
    b"",
    b"x",
    b"1e-320",
    b"1,5",
    b"\xff",
    b"\0",
    b"9" * 400,
    b"1e12",
]
NUMBER = re.compile(rb"-?\d+\.?\d*(?:e[+-]\d+)?")
Body = dict[str, Any]

# ---- arrays


def scaled(rng: random.Random, body: Body) -> None:
    body["points"] *= rng.choice([1e-300, 1e-200, 1e-31, 1e-9, 1e9, 1e29, 1e31, 1e200, -1.0, 0.0])


def not_finite(rng: random.Random, body: Body) -> None:
    body["points"].flat[rng.randrange(body["points"].size)] = rng.choice(
        [np.nan, np.inf, -np.inf, 1e308, 1e25]
    )


def moved(rng: random.Random, body: Body) -> None:
    body["points"][rng.randrange(len(body["points"]))] += [
        rng.uniform(-2, 2),
        rng.uniform(-2, 2),
        0.0,
    ]


def doubled_points(rng: random.Random, body: Body) -> None:
    body["cells"] = body["cells"] + len(body["points"]) * (
        np.arange(len(body["cells"]))[:, None] % rng.choice([2, 3]) > 0
    )
    body["points"] = np.tile(body["points"], (2, 1))


def doubled_cells(rng: random.Random, body: Body) -> None:
    body["cells"] = np.vstack([body["cells"], body["cells"][: rng.choice([1, 2, 50])]])


def unused_points(rng: random.Random, body: Body) -> None:
    body["points"] = np.vstack(
        [body["points"], [[rng.choice([0.0, 1e9, np.nan])] * 3] * rng.choice([1, 100])]
    )


def flat_cells(rng: random.Random, body: Body) -> None:
    body["cells"][rng.randrange(len(body["cells"]))] = rng.randrange(len(body["points"]))


def other_corners(rng: random.Random, body: Body) -> None:
    """Replace a corner of a cell by a distant point, by none, or by one of the last points."""
    count = len(body["points"])
    corner = rng.choice([rng.randrange(count), -1, -2, count, 2**31 - 1, 2**40, -(2**31)])
    body["cells"] = body["cells"].astype(np.int64)
    body["cells"][rng.randrange(len(body["cells"])), 0] = corner


def shuffled(rng: random.Random, body: Body) -> None:
    order = np.array(rng.sample(range(len(body["points"])), len(body["points"])))
    body["points"] = (
        body["points"][order] if rng.random() < 0.5 else body["points"][np.sort(order)[::-1]]
    )


def few_cells(rng: random.Random, body: Body) -> None:
    body["cells"] = body["cells"][: rng.choice([0, 1, 2, len(body["cells"]) // 2])]
    body["regions"] = {}


def other_facets(rng: random.Random, body: Body) -> None:
    name = rng.choice([*body["facets"], "lid"])
    facets = body["facets"].get(name, body["cells"][:4, 1:])
    body["facets"][name] = rng.choice(
        [facets[:0], facets[::-1], facets[:, ::-1], facets + 1, facets[:1], facets * 0]
    )


def other_names(rng: random.Random, body: Body) -> None:
    name = rng.choice(
        [
            "",
            " ",
            "top",
            '"',
            "a\nb",
            "$EndPhysicalNames",
            "ä漢🙂",
            "x" * 1_000_000,
            "<&>",
            "../x",
            "\x1b[2J",
        ]
    )
    body["facets"] = {
        name if key == "wall" else key: facets for key, facets in body["facets"].items()
    }


def alone(rng: random.Random, body: Body) -> None:
    body["facets"] = {}
    if rng.random() < 0.5:
        body["regions"] = {}


def turned(rng: random.Random, body: Body) -> None:
    body["points"] = body["points"][
        :, list(rng.choice([(1, 0, 2), (0, 2, 1), (2, 1, 0), (0, 1, 1)]))
    ]


def as_it_is(rng: random.Random, body: Body) -> None:
    pass


ARRAYS: list[Callable[[random.Random, Body], None]] = [
    scaled,
    not_finite,
    moved,
    doubled_points,
    doubled_cells,
    unused_points,
    flat_cells,
    other_corners,
    shuffled,
    few_cells,
    other_facets,
    other_names,
    alone,
    turned,
    as_it_is,
]

# ---- bytes


def cut(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def flipped(rng: random.Random, data: bytes) -> bytes:
    share = rng.choice([1e-4, 1e-2])
    return bytes(b ^ (rng.random() < share) * rng.randrange(256) for b in data)


def without_a_part(rng: random.Random, data: bytes) -> bytes:
    begin, length = rng.randrange(len(data) + 1), rng.choice([1, 10, 1000])
    return data[:begin] + data[begin + length :]


def with_a_part_twice(rng: random.Random, data: bytes) -> bytes:
    begin, length = rng.randrange(len(data) + 1), rng.choice([1, 10, 1000, len(data)])
    return data[: begin + length] + data[begin:]


def other_numbers(rng: random.Random, data: bytes) -> bytes:
    """Replace some of the numbers of a text, or one number wherever it stands."""
    if not (found := list(NUMBER.finditer(data))):
        return data
    if rng.random() < 0.2:
        return data.replace(rng.choice(found).group(), rng.choice(NUMBERS))
    for one in sorted(
        rng.sample(found, min(len(found), rng.choice([1, 1, 3]))), key=lambda one: -one.start()
    ):
        data = data[: one.start()] + rng.choice(NUMBERS) + data[one.end() :]
    return data


def other_counts(rng: random.Random, data: bytes) -> bytes:
    """Replace one of the first numbers, which often is a count."""
    if not (found := list(NUMBER.finditer(data))[:60]):
        return data
    one = rng.choice(found)
    return (
        data[: one.start()]
        + rng.choice([b"0", b"-1", one.group() + b"0", one.group() + b"00000000", b"1", *NUMBERS])
        + data[one.end() :]
    )


def other_lines(rng: random.Random, data: bytes) -> bytes:
    lines = data.split(b"\n")
    first, second = sorted(rng.choices(range(len(lines)), k=2))
    lines[first], lines[second] = lines[second], lines[first]
    return b"\n".join(lines) if rng.random() < 0.5 else b"\n".join(lines[:first] + lines[second:])


def recoded(rng: random.Random, data: bytes) -> bytes:
    return rng.choice(
        [
            b"\xef\xbb\xbf" + data,
            data.replace(b"\n", b"\r\n"),
            data.decode("latin-1").encode("utf-16"),
            data.replace(b"\n", b"\r"),
            data.upper(),
            data.replace(b" ", b"\t"),
            b"\n" + data,
        ]
    )


def inflated(rng: random.Random, data: bytes) -> bytes:
    """Return the file inflated to the largest allowed size by filler, or by copies of itself."""
    room = MOST_BYTES - len(data)
    begin = rng.choice([0, len(data), rng.randrange(len(data) + 1)])
    more = rng.choice(
        [
            b"\0" * room,
            b" " * room,
            b"\n" * room,
            b"x" * room,
            b"1 " * (room // 2),
            b"9" * room,
            data * (room // max(len(data), 1)),
        ]
    )
    return data[:begin] + more + data[begin:]


BYTES: list[Callable[[random.Random, bytes], bytes]] = [
    cut,
    flipped,
    without_a_part,
    with_a_part_twice,
    other_numbers,
    other_numbers,
    other_counts,
    other_counts,
    other_lines,
    recoded,
    inflated,
]


def spoilt(rng: random.Random, path: Path) -> Path:
    """Damage the bytes of a file, or of the HDF5 file beside it."""
    beside = path.with_suffix(".h5")
    target = beside if beside.exists() and rng.random() < 0.6 else path
    for _ in range(rng.choice([1, 1, 2])):
        target.write_bytes(rng.choice(BYTES)(rng, target.read_bytes())[:MOST_BYTES])
    return path


# ---- files


def _version_4(binary: bool, path: Path, body: Body) -> None:
    """Write a file of gmsh 4.1 with one entity for each name.

    meshio itself writes cells of one kind alone.
    """
    dim, out = body["cells"].shape[1] - 1, bytearray(f"$MeshFormat\n4.1 {int(binary)} 8\n".encode())
    parts = [(dim - 1, name, facets) for name, facets in body["facets"].items()] + [
        (dim, "gel", body["cells"])
    ]

    def put(values: Any, kind: Any) -> None:
        values = np.atleast_1d(np.asarray(values, dtype=kind)).ravel()
        out.extend(
            values.tobytes() if binary else (" ".join(map(str, values.tolist())) + "\n").encode()
        )

    if binary:
        out.extend(b"\1\0\0\0\n")
    names = "".join(f'{of} {k + 1} "{name}"\n' for k, (of, name, _) in enumerate(parts))
    out.extend(
        f"$EndMeshFormat\n$PhysicalNames\n{len(parts)}\n{names}$EndPhysicalNames\n$Entities\n".encode()
    )
    put([sum(of == d for of, _, _ in parts) for d in range(4)], np.uint64)
    for tag, (_, _, _) in sorted(enumerate(parts), key=lambda one: one[1][0]):
        put(tag + 1, np.int32)
        put([0.0] * 6, float)
        put(1, np.uint64)
        put(tag + 1, np.int32)
        put(0, np.uint64)
    out.extend(b"\n$EndEntities\n$Nodes\n")
    put([1, len(body["points"]), 1, len(body["points"])], np.uint64)
    put([dim, len(parts), 0], np.int32)
    put(len(body["points"]), np.uint64)
    put(np.arange(len(body["points"])) + 1, np.uint64)
    put(body["points"], float)
    out.extend(b"\n$EndNodes\n$Elements\n")
    put([len(parts), sum(len(cells) for _, _, cells in parts), 1, 9**6], np.uint64)
    for tag, (of, _, cells) in enumerate(parts):
        put([of, tag + 1, {1: 1, 2: 2, 3: 4}[of]], np.int32)
        put(len(cells), np.uint64)
        put(np.column_stack([np.arange(len(cells)), cells + 1]).astype(np.int64), np.uint64)
    out.extend(b"\n$EndElements\n")
    path.write_bytes(out)


def _version_40(binary: bool, path: Path, body: Body) -> None:
    kind = {3: "triangle", 4: "tetra"}[body["cells"].shape[1]]
    meshio.gmsh.write(
        path, meshio.Mesh(body["points"], [(kind, body["cells"])]), fmt_version="4.0", binary=binary
    )


KINDS: list[tuple[str, Callable[[Path, Body], Any]]] = [
    (".msh", partial(write, binary=False)),
    (".msh", partial(write, binary=True)),
    (".msh", partial(_version_4, False)),
    (".msh", partial(_version_4, True)),
    (".msh", partial(_version_40, False)),
    (".msh", partial(_version_40, True)),
    (".inp", write),
    (".inp", write),
    (".vtu", partial(write, binary=False)),
    (".vtu", partial(write, compression=None)),
    (".vtu", write),
    (".vtu", partial(write, compression="lzma")),
    (".xdmf", write),
    (".xdmf", write),
    (".xdmf", partial(write, data_format="XML")),
    (".xdmf", partial(write, compression=None)),
]


def valid(rng: random.Random, folder: Path, body: Body) -> Path:
    """Write a body into a file of any kind, or as much of it as can be written."""
    suffix, write_as = rng.choice(KINDS)
    path = folder / f"part{suffix}"
    path.write_bytes(b"")
    with suppress(
        ValueError, IndexError, OverflowError, KeyError, UnicodeError, TypeError, meshio.WriteError
    ):
        write_as(path, body)  # meshio itself refuses some arrays
    return path


# ---- bombs


def sparse_numbers(rng: random.Random, folder: Path) -> Path:
    """Write nodes with numbers up to 1e12; readers make a table up to the largest number."""
    most = rng.choice([10**7, 10**9, 2**31, 2**32 + 1, 10**12])
    old = rng.random() < 0.5
    nodes = [(1, "0 -1 0"), (2, "1 -1 0"), (3, "1 0 0"), (most, "0 0 0")]
    cells = [(1, 2, 3), (1, 3, most)]
    if old:
        text = [
            "$MeshFormat",
            "2.2 0 8",
            "$EndMeshFormat",
            "$Nodes",
            "4",
            *(f"{n} {x}" for n, x in nodes),
            "$EndNodes",
            "$Elements",
            "2",
            *(f"{k + 1} 2 2 0 1 {a} {b} {c}" for k, (a, b, c) in enumerate(cells)),
            "$EndElements",
        ]
    else:
        text = [
            "$MeshFormat",
            "4.1 0 8",
            "$EndMeshFormat",
            "$Nodes",
            f"1 4 1 {most}",
            "2 1 0 4",
            *(str(n) for n, _ in nodes),
            *(x for _, x in nodes),
            "$EndNodes",
            "$Elements",
            "1 2 1 2",
            "2 1 2 2",
            *(f"{k + 1} {a} {b} {c}" for k, (a, b, c) in enumerate(cells)),
            "$EndElements",
        ]
    (folder / "part.msh").write_text("\n".join([*text, ""]))
    return folder / "part.msh"


def many_names(rng: random.Random, folder: Path) -> Path:
    count = rng.choice([MOST_BYTES // 1000, MOST_BYTES // 50])
    path = write(folder / "part.msh", section(), binary=False)
    text = path.read_text()
    names = "".join(f'1 {k + 10} "name{k}"\n' for k in range(count))
    path.write_text(text.replace("$PhysicalNames\n4\n", f"$PhysicalNames\n{count + 4}\n{names}"))
    return path


def generated_sets(rng: random.Random, folder: Path) -> Path:
    path = write(folder / "part.inp", section())
    kind = rng.choice(["NSET", "ELSET"])
    one = rng.choice(
        [
            "1, 2147483646, 1",
            "1, 45, 0",
            "45, 1, -1",
            "1, 45",
            "-5, 5, 1",
            "1, 99999999999999999999, 1",
            "1, 45, 1",
            "a, b, c",
            "1.5, 2, 1",
        ]
    )
    sets = "".join(
        f"*{kind}, {kind}=s{k}, GENERATE\n{one}\n"
        for k in range(rng.choice([1, MOST_BYTES // 500]))
    )
    path.write_text(path.read_text() + sets)
    return path


def many_blocks(rng: random.Random, folder: Path) -> Path:
    """Write so many blocks and sets that a search of all blocks for each set is quadratic."""
    path = write(folder / "part.inp", section())
    blocks = "".join(
        f"*ELEMENT, TYPE=CPS3\n{k + 10**6}, 1, 2, 11\n" for k in range(MOST_BYTES // 500)
    )
    sets = "".join(f"*ELSET, ELSET=s{k}\n1, 2, 3\n" for k in range(MOST_BYTES // 500))
    path.write_text(path.read_text() + blocks + sets)
    return path


def long_lines(rng: random.Random, folder: Path) -> Path:
    path = folder / rng.choice(["part.inp", "part.msh", "part.vtu", "part.xdmf"])
    begin = {
        ".inp": "*NODE\n1, ",
        ".msh": "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1\n1 ",
        ".vtu": "<VTKFile type='",
        ".xdmf": "<Xdmf Version='",
    }[path.suffix]
    path.write_text(
        (begin + rng.choice(["9", "1 ", "1,", "x", "[", "("]) * MOST_BYTES)[:MOST_BYTES]
    )
    return path


def nested(rng: random.Random, folder: Path) -> Path:
    path = folder / rng.choice(["part.vtu", "part.xdmf"])
    lol = "".join(f"<!ENTITY l{k} '{f'&l{k - 1};' * 10}'>" for k in range(1, 12))
    bomb = f"<?xml version='1.0'?><!DOCTYPE x [<!ENTITY l0 'lol'>{lol}]><VTKFile>&l11;</VTKFile>"
    outside = (
        "<?xml version='1.0'?><!DOCTYPE x [<!ENTITY e SYSTEM "
        "'file:///etc/passwd'>]><Xdmf Version='3.0'>&e;</Xdmf>"
    )
    path.write_text(
        rng.choice(
            [bomb, outside, "<a>" * (MOST_BYTES // 3), "<a " + "b='c' " * (MOST_BYTES // 9) + "/>"]
        )
    )
    return path


def packed_zeros(rng: random.Random, folder: Path) -> Path:
    """Write a VTU file whose few bytes unpack to gigabytes.

    They are text of base64, in as many blocks as the file says.
    """
    size = rng.choice([10, 100]) * MOST_BYTES
    packed = zlib.compress(b"\0" * size, 9)
    blocks = rng.choice([1, 4])
    header = np.array([blocks, size, size, *[len(packed)] * blocks], dtype=np.uint32).tobytes()
    data = (b64encode(header) + b64encode(packed * blocks)).decode()
    array = (
        "<DataArray type='Float64' Name='Points' NumberOfComponents='3' "
        f"format='binary'>{data}</DataArray>"
    )
    (folder / "part.vtu").write_text(
        "<VTKFile type='UnstructuredGrid' version='0.1' byte_order='LittleEndian' "
        "compressor='vtkZLibDataCompressor'>"
        f"<UnstructuredGrid><Piece NumberOfPoints='{blocks * size // 24}' "
        f"NumberOfCells='0'><Points>{array}</Points>"
        "</Piece></UnstructuredGrid></VTKFile>"
    )
    return folder / "part.vtu"


def kept_elsewhere(rng: random.Random, folder: Path) -> Path:
    """Write an XDMF file whose HDF5 data are links, bombs, or no numbers at all."""
    path = write(folder / "part.xdmf", section())
    (folder / "other.h5").write_bytes((folder / "part.h5").read_bytes())
    with h5py.File(folder / "part.h5", "a") as store:
        name = rng.choice([*store])
        shape = store[name].shape
        first = store[name][()]
        del store[name]
        KEPT[rng.choice([*KEPT])](store, name, first, shape)
    return path


def _soft_onto_external(store: Any, name: str, first: Any, shape: Any) -> None:
    store["away"] = h5py.ExternalLink("other.h5", f"/{name}")
    store[name] = h5py.SoftLink("/away")


def _virtual(store: Any, name: str, first: Any, shape: Any) -> None:
    layout = h5py.VirtualLayout(shape, first.dtype)
    layout[:] = h5py.VirtualSource("other.h5", name, shape)
    store.create_virtual_dataset(name, layout)


KEPT: dict[str, Callable[[Any, str, Any, Any], Any]] = {
    "external link": lambda store, name, first, shape: store.__setitem__(
        name, h5py.ExternalLink("other.h5", f"/{name}")
    ),
    "soft onto external": _soft_onto_external,
    "soft onto itself": lambda store, name, first, shape: store.__setitem__(
        name, h5py.SoftLink(f"/{name}")
    ),
    "virtual": _virtual,
    "external storage": lambda store, name, first, shape: store.create_dataset(
        name, shape, first.dtype, external=[("/etc/passwd", 0, first.nbytes)]
    ),
    "strings": lambda store, name, first, shape: store.__setitem__(name, first.astype("S20")),
    "complex": lambda store, name, first, shape: store.__setitem__(name, first.astype(complex)),
    "floats": lambda store, name, first, shape: store.__setitem__(name, first.astype(float) + 0.25),
    "booleans": lambda store, name, first, shape: store.__setitem__(name, first.astype(bool)),
    "half precision": lambda store, name, first, shape: store.__setitem__(
        name, first.astype(np.float16)
    ),
    "six columns": lambda store, name, first, shape: store.__setitem__(
        name, np.tile(first.reshape(len(first), -1), 2)
    ),
    "a scalar": lambda store, name, first, shape: store.__setitem__(name, 1.0),
    "nothing": lambda store, name, first, shape: store.create_dataset(name, data=h5py.Empty("f8")),
    "zeros of 2 GB": lambda store, name, first, shape: store.create_dataset(
        name, (2**28, *shape[1:]), first.dtype, chunks=(2**14, *shape[1:])
    ),
    "a terabyte": lambda store, name, first, shape: store.create_dataset(
        name, (2**40, *shape[1:]), first.dtype, chunks=(2**14, *shape[1:]), compression="gzip"
    ),
    "packed zeros": lambda store, name, first, shape: store.create_dataset(
        name, data=np.zeros((2**22, *shape[1:]), first.dtype), compression="gzip"
    ),
    "references": lambda store, name, first, shape: store.create_dataset(
        name, data=[store.ref] * 9, dtype=h5py.ref_dtype
    ),
    "a group": lambda store, name, first, shape: store.create_group(name),
    "text of any length": lambda store, name, first, shape: store.create_dataset(
        name, data=["x" * 10**6] * 3, dtype=h5py.string_dtype()
    ),
}


def no_mesh(rng: random.Random, folder: Path) -> Path:
    path = (
        folder
        / f"part{rng.choice(['.msh', '.vtu', '.xdmf', '.inp', '.vtk', '.bdf', '.h5', '.MSH', ''])}"
    )
    path.write_bytes(
        rng.choice(
            [
                b"",
                b"\0" * MOST_BYTES,
                rng.randbytes(1000),
                b"$MeshFormat\n",
                b"<",
                b"<Xdmf/>",
                b"*NODE\n",
                b"$MeshFormat\n4.1 1 8\n" + b"\1\0\0\0",
                b"$" * 10**6,
                b"*" * 10**6,
            ]
        )
    )
    return path


BOMBS: list[Callable[[random.Random, Path], Path]] = [
    sparse_numbers,
    many_names,
    generated_sets,
    many_blocks,
    long_lines,
    nested,
    packed_zeros,
    kept_elsewhere,
    kept_elsewhere,
    no_mesh,
    no_mesh,
]
NAMED = [
    "surfaces: {contact: top, base: bottom, sides: wall}",
    "surfaces: {contact: top, base: bottom}",
    "sides: roller",
    "surfaces: {contact: part=1, base: part=2, sides: part=3}",
    "surfaces: {contact: part=1}",
    "sides: free",
]


def hostile(seed: int, folder: Path) -> Path:
    """Write a hostile mesh file and a scene that uses it into a folder."""
    rng = random.Random(seed)
    is_solid = rng.random() < 0.4
    kinematics = "3d" if is_solid else rng.choice(["axisymmetric", "plane_strain"])
    body = block(n=3, m=2) if is_solid else section(n=6, m=3)
    what = rng.choices(["arrays", "bytes", "both", "bomb"], weights=[35, 40, 10, 15])[0]
    if what == "bomb":
        path = rng.choice(BOMBS)(rng, folder)
    else:
        for spoil in rng.sample(ARRAYS, rng.choice([1, 1, 2])) if what != "bytes" else []:
            with (
                np.errstate(all="ignore"),
                suppress(ValueError),
            ):  # of cells that another one took away
                spoil(rng, body)
        path = valid(rng, folder, body)
        path = path if what == "arrays" else spoilt(rng, path)
    if rng.random() < 0.05:
        kinematics = rng.choice(["axisymmetric", "plane_strain", "3d"])
    surfaces = rng.choice(NAMED[:3] if path.suffix in (".msh", ".inp") else NAMED[2:])
    (folder / "scene.yaml").write_text(
        f"body: {{shape: mesh, file: {path.name}, kinematics: {kinematics}, {surfaces}}}\n"
        "material: {model: linear_elastic, E: 1.0, nu: 0.3}\nindenter: {shape: "
        "paraboloid, R: 1.0}\n"
        "loading: {delta: 0.02}\n"
    )
    return folder / "scene.yaml"
