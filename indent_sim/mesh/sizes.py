"""The element-size field, in numpy and in the language of gmsh."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from indent_sim.mesh.modelled_part import Side
from indent_sim.model.body import EllipsoidInclusion, Inclusion, Shell

DOUBTFUL_ELEMENTS = 3.0  # elements per contact radius below which results are doubtful


@dataclass(frozen=True)
class Film:
    """A drained face of a section, beside which the pressure of the fluid changes within a film.

    Elements at the face have the size h [length], up to a distance `reach` [length] from where the
    tip touches first; from there sizes grow by `grading` along the face and away from it alike.
    """

    side: Side
    h: float
    reach: float


@dataclass(frozen=True)
class Sizes:
    """Element sizes [length].

    h_contact inside `patch` of the tip's `axis` (x, y), growing by `grading` per unit distance
    outside it up to h_far; around a sharp edge at radius `edge` it shrinks to h_edge, from `rubbed`
    inside that radius on, around `corners` (r, depth) to h_corner. Where h_axis is given, sizes
    inside the expected contact radius `a` are the share of it that the distance from the axis is,
    but at least h_axis: so a contact of any radius down to a h_axis/h_contact finds as many
    elements as the last one. inclusions, skins: each with the size inside it, which grows by
    `grading` outside. films: drained faces, with h_film, the size at those next to the contact.
    """

    h_contact: float
    h_far: float
    patch: float
    grading: float = 0.2
    edge: float | None = None
    h_edge: float | None = None
    h_axis: float | None = None
    a: float = 0.0
    corners: tuple[tuple[float, float], ...] = ()
    h_corner: float | None = None
    corner_error: float = 0.0  # of the force, at most, what the elements at corners cost
    inclusions: tuple[tuple[Inclusion, float], ...] = ()
    skins: tuple[tuple[Shell, float], ...] = ()
    films: tuple[Film, ...] = ()
    h_film: float | None = None
    keenness: float = (
        1.0  # how much more than on a far larger body the force feels the radius of a sharp punch
    )
    rubbed: float = (
        0.0  # width of a punch's rounded edge, where friction at finite strain needs all of it fine
    )
    refinements: int | None = (
        None  # of a mesh from a file, which has these sizes then; None: they are to be meshed
    )
    axis: tuple[float, ...] = field(kw_only=True)

    @property
    def typical(self) -> float:
        """Between the sizes at the axis and at the edge of the contact, in the geometric mean
        [length].
        """
        return (
            self.h_contact if self.h_axis is None else float(np.sqrt(self.h_axis * self.h_contact))
        )

    @property
    def smallest(self) -> float:
        """The size at the axis [length]."""
        return self.h_axis or self.h_contact

    @property
    def finest(self) -> float:
        """The smallest size anywhere [length]."""
        inside = [
            *(h for _, h in (*self.inclusions, *self.skins)),
            *(film.h for film in self.films),
        ]
        return min(
            self.smallest, self.h_edge or self.smallest, self.h_corner or self.smallest, *inside
        )

    @property
    def points(self) -> list[tuple[float, float, float]]:
        """(r, depth, size) [length] of the places towards which elements shrink: a punch's edge,
        the felt corners.
        """
        edge = [] if self.edge is None or self.h_edge is None else [(self.edge, 0.0, self.h_edge)]
        return edge + [
            (r, depth, self.h_corner) for r, depth in self.corners if self.h_corner is not None
        ]

    @property
    def slope(self) -> float:
        """Growth of the size per unit distance from the axis, inside the contact, where there is
        one.
        """
        return self.h_contact / self.a

    def at(self, r: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """The element size [length] at distance r from the tip's axis and a depth, far from
        inclusions, skins and drained faces.
        """
        near: Any = self.h_contact
        if self.h_axis is not None:  # not np.clip, which costs ten times as much for one place
            near = np.minimum(np.maximum(self.slope * r, self.h_axis), self.h_contact)
        size = near + self.grading * np.hypot(np.maximum(r - self.patch, 0.0), depth)
        for at, below, smallest in self.points:
            size = np.minimum(size, smallest + self.grading * np.hypot(r - at, depth - below))
        if self.rubbed and self.edge is not None and self.h_edge is not None:
            middle, half = self._middle_of_rubbed
            beside = np.maximum(np.abs(r - middle) - half, 0.0)
            size = np.minimum(size, self.h_edge + self.grading * np.hypot(beside, depth))
        return np.minimum(size, self.h_far)

    @property
    def _middle_of_rubbed(self) -> tuple[float, float]:
        """The middle of the rounded edge and half its width [length]."""
        assert self.edge is not None
        return self.edge - self.rubbed / 2, self.rubbed / 2

    def elements(self, a: float) -> float:
        """How many elements there are in a contact radius a, judged by the one where it ends."""
        return a / self.on_surface(a)

    def on_surface(self, r: float) -> float:
        """The size of the elements of the surface at a distance from the contact's middle."""
        return float(self.at(np.array(r), np.array(0.0)))

    def is_enough(self, a: float) -> bool:
        """Whether a contact of radius a is resolved; a punch's is known before, and its edge
        refined.
        """
        return self.edge is not None or self.elements(a) >= DOUBTFUL_ELEMENTS


def size_formula(sizes: Sizes, dim: int) -> str:
    """The element size at (x, y[, z]) as a gmsh MathEval expression (gmsh has no min or max there)."""
    number = "{:.12g}".format
    x, y = (*map(number, sizes.axis), "")[:2]
    r = f"Sqrt((x-({x}))^2+(y-({y}))^2)"
    depth = "Abs(z)"
    if dim == 2:
        r = f"Abs(x-({x}))"
        depth = "Abs(y)"
    outside = _positive(f"({r}-{number(sizes.patch)})")
    near = number(sizes.h_contact)
    if sizes.h_axis is not None:
        near = _smaller(near, _larger(number(sizes.h_axis), f"{number(sizes.slope)}*{r}"))
    size = f"{near}+{number(sizes.grading)}*Sqrt({outside}^2+{depth}^2)"
    for at, below, smallest in sizes.points:
        around = f"Sqrt(({r}-{number(at)})^2+({depth}-{number(below)})^2)"
        size = _smaller(size, f"{number(smallest)}+{number(sizes.grading)}*{around}")
    if sizes.rubbed and sizes.h_edge is not None:
        middle, half = map(number, sizes._middle_of_rubbed)
        beside = _positive(f"(Abs({r}-({middle}))-{half})")
        size = _smaller(
            size, f"{number(sizes.h_edge)}+{number(sizes.grading)}*Sqrt({beside}^2+{depth}^2)"
        )
    return _smaller(size, number(sizes.h_far))


def formula_around(inclusion: Inclusion, inside: float, grading: float, dim: int) -> str:
    """The element size that an inclusion wants: the one inside it, growing with
    `Inclusion.distance`, of an ellipsoid to first order.
    """
    number = "{:.12g}".format
    names = ("x", "0", "y") if dim == 2 else ("x", "y", "z")
    if isinstance(inclusion, EllipsoidInclusion):
        off = [f"({name}-({number(c)}))" for name, c in zip(names, inclusion.center, strict=True)]
        seen = list(zip(off, inclusion.semi_axes, strict=True))
        rho, steep = ("+".join(f"({d}/{number(s**n)})^2" for d, s in seen) for n in (1, 2))
        distance = f"Sqrt({rho})*{_positive(f'(Sqrt({rho})-1)')}/Sqrt({steep}+1e-30)"
        return f"{number(inside)}+{number(grading)}*{distance}"
    beyond = []
    for axes, half in inclusion.spans:
        squares = "+".join(f"({names[axis]}-({number(inclusion.center[axis])}))^2" for axis in axes)
        beyond.append(f"{_positive(f'(Sqrt({squares})-{number(half)})')}^2")
    return f"{number(inside)}+{number(grading)}*Sqrt({'+'.join(beyond)})"


def formula_beside(skin: Shell, inside: float, grading: float) -> str:
    """The element size that a skin wants in a section: the one inside it, growing with the distance
    from it.
    """
    number = "{:.12g}".format
    rho = f"Sqrt(x^2+(y-({number(skin.center[2])}))^2)"
    beyond = (
        f"{_positive(f'({rho}-{number(skin.outer)})')}+{_positive(f'({number(skin.inner)}-{rho})')}"
    )
    return f"{number(inside)}+{number(grading)}*({beyond})"


def formula_at_face(film: Film, axis: float, grading: float) -> str:
    """The element size that a drained face wants in a section, of a tip whose axis is at x =
    `axis`.
    """
    number = "{:.12g}".format
    if film.side.middle is not None:
        x, y = map(number, film.side.middle)
        distance = f"Abs({number(film.side.radius)}-Sqrt((x-({x}))^2+(y-({y}))^2))"
    else:
        (x0, y0) = film.side.start
        (x1, y1) = film.side.end
        length = float(np.hypot(x1 - x0, y1 - y0))
        along_x = number((x1 - x0) / length)
        along_y = number((y1 - y0) / length)
        distance = f"Abs(({along_x})*(y-({number(y0)}))-({along_y})*(x-({number(x0)})))"
    beyond = _positive(f"(Sqrt((x-({number(axis)}))^2+y^2)-{number(film.reach)})")
    return f"{number(film.h)}+{number(grading)}*({distance}+{beyond})"


def _positive(a: str) -> str:
    return f"(0.5*({a}+Abs({a})))"


def _larger(a: str, b: str) -> str:
    return f"(0.5*(({a})+({b})+Abs(({a})-({b}))))"


def _smaller(a: str, b: str) -> str:
    return f"(0.5*(({a})+({b})-Abs(({a})-({b}))))"
