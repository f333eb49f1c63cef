"""Element sizes from the expected contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Elements per contact radius that keep the force within 0.3 % at the last step (measured on HERTZ axi and cube)
PER_RADIUS = {(2, 2): 10.0, (2, 1): 40.0, (3, 2): 5.0, (3, 1): 16.0}  # (dim, order)
GRADING = {2: 0.2, 1: 0.1}  # growth of the size per unit distance, by order
PER_WALL_RADIUS = 8.0  # elements per radius of a curved wall: its polygon encloses 0.3 % less than the circle, which
# an incompressible body between roller walls feels as much
PATCH = 1.15  # the fine patch reaches this far beyond the expected contact radius
ENOUGH = {2: 3.0, 1: 10.0}  # elements per contact radius below which results are doubtful, by order
LINEAR = 0.006  # of the force, what linear elements far from the contact cost
AUTO = 0.003  # of the force, the error that the sizes left to the program may cost
HARDLY = 0.45  # Poisson ratio from which a body is said to hardly compress
TELLING = 0.005  # of the force: a smaller error is not worth a warning
SMALLEST = 1e-4  # contact radius of the last step, of the largest one, that still gets as many elements
EDGE_RATIO = {2: 20.0, 3: 4.0}  # refinement towards a punch's sharp edge, where the pressure is singular


@dataclass(frozen=True)
class Sizes:
    """Element sizes [length] and order.

    h_contact inside `patch` of the tip's axis, growing by `grading` per unit distance outside it up to h_far;
    around a sharp edge at radius `edge` it shrinks to h_edge, around `corners` (r, depth) to h_corner. Where h_axis is
    given, sizes inside the expected contact radius `a` are the share of it that the distance from the axis is, but at
    least h_axis: so a contact of any radius down to a h_axis/h_contact finds as many elements as the last one.
    """

    h_contact: float
    h_far: float
    patch: float
    order: int = 2
    grading: float = 0.2
    edge: float | None = None
    h_edge: float | None = None
    h_axis: float | None = None
    a: float = 0.0
    corners: tuple[tuple[float, float], ...] = ()
    h_corner: float | None = None
    corner_error: float = 0.0  # of the force, at most, what elements at corners cost that are left as they are
    ruled_by_corners: bool = False  # whose elements are no smaller than those around, and rule how the force converges
    keenness: float = 1.0  # how much more than on a far larger body the force feels the radius of a sharp punch

    @property
    def typical(self) -> float:
        """Between the sizes at the axis and at the edge of the contact, in the geometric mean [length]."""
        return self.h_contact if self.h_axis is None else float(np.sqrt(self.h_axis * self.h_contact))

    @property
    def smallest(self) -> float:
        """The size at the axis [length]."""
        return self.h_axis or self.h_contact

    @property
    def finest(self) -> float:
        """The smallest size anywhere [length]."""
        return min(self.smallest, self.h_edge or self.smallest, self.h_corner or self.smallest)

    @property
    def points(self) -> list[tuple[float, float, float]]:
        """(r, depth, size) [length] of the places towards which elements shrink: a punch's edge, the felt corners."""
        edge = [] if self.edge is None or self.h_edge is None else [(self.edge, 0.0, self.h_edge)]
        return edge + [(r, depth, self.h_corner) for r, depth in self.corners if self.h_corner is not None]

    @property
    def slope(self) -> float:
        """Growth of the size per unit distance from the axis, inside the contact, where there is one."""
        return self.h_contact / self.a

    def at(self, r: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """The element size [length] at distance r from the tip's axis and a depth below the surface."""
        near = self.h_contact if self.h_axis is None else np.clip(self.slope * r, self.h_axis, self.h_contact)
        size = near + self.grading * np.hypot(np.maximum(r - self.patch, 0.0), depth)
        for at, below, smallest in self.points:
            size = np.minimum(size, smallest + self.grading * np.hypot(r - at, depth - below))
        return np.minimum(size, self.h_far)

    def elements(self, a: float) -> float:
        """How many elements there are in a contact radius a, judged by the one where it ends."""
        return a / float(self.at(np.array(a), np.array(0.0)))

    def is_enough(self, a: float) -> bool:
        """Whether a contact of radius a is resolved; a punch's is known before, and its edge refined."""
        return self.edge is not None or self.elements(a) >= ENOUGH[self.order]

    def force_doubt(self, a: float, nu: float) -> float:
        """The relative error of the force to fear on this mesh with the expected contact radius a; 0 for none.

        Measured on a layer (axisymmetric, all methods, quadratic elements): at most 0.3, 0.9, 2.3, 2.4, 5.5, 15, 20 and
        117 % with n = 3, 2, 1.5, 1, 0.7, 0.5, 0.3 and 0.1 elements: below 7/n^2 %. Linear elements, nu = 0 to 0.3: 0.9,
        0.6, 0.4 and 0.3 % with n = 10, 16, 40 and 80, twice as much with nu = 0.45. A punch's sharp edge: below a
        quarter of the size of its elements over its radius (axisymmetric and in three dimensions), 0.65 of it where the
        body hardly compresses; times `keenness`.
        """
        n = self.elements(a)
        linear = (LINEAR + 0.25 / min(n, n**2)) * max(1.0, 0.6 / np.sqrt(1 - 2 * nu)) if self.order == 1 else 0.0
        if self.edge is not None and self.h_edge is not None:
            blunt = (0.25 if nu < HARDLY else 0.65) * self.keenness * self.h_edge / self.edge
            return float(max(blunt, LINEAR if linear else 0.0))
        return float(linear) if linear else 0.0 if self.is_enough(a) else 0.07 / n**2

    def doubts(self, a: float, nu: float) -> list[str]:
        """What too few elements in the expected contact radius a will do to the results, in words.

        Measured on HERTZ (axisymmetric, strip, cube) with n = 0.7 to 20 elements in a: the force is wrong by up to
        25/n % with linear elements (too high); a by 5 % with quadratic and 11 % with linear elements.
        """
        likely, doubts = self.force_doubt(a, nu), []
        if self.corner_error >= TELLING:
            doubts.append(
                "coarse elements at corners that the contact feels: the force may be too high by up to "
                f"{in_words(self.corner_error)}; use smaller sizes everywhere, or leave them to the program"
            )
        if self.edge is not None and self.h_edge is not None:
            of_radius = f"elements of {self.h_edge / self.edge:.2g} radii at the punch's edge"
            if likely >= TELLING:
                doubts.append(
                    f"{of_radius}: the force may be too low by {in_words(likely)}; give a smaller h_contact or h_edge"
                )
            return doubts
        if not self.is_enough(a):
            of_a = {1: 11, 2: 5}[self.order]
            doubts.append(
                f"only {a / self.h_contact:.2g} elements in the expected contact radius: the force may be wrong by "
                f"{in_words(likely)}, a by up to {of_a} %; give h_contact at most {1 / ENOUGH[self.order]:.2g} of the "
                "contact radius"
            )
        elif self.order == 1:
            doubts.append(f"linear elements: the force may be too high by {in_words(likely)}; order: 2 costs no more")
        return doubts


@dataclass(frozen=True)
class Given:
    """Sizes [length] and grading that are settled; None: left to `choose`."""

    h_contact: float | None = None
    h_axis: float | None = None
    h_edge: float | None = None
    h_corner: float | None = None
    h_far: float | None = None
    grading: float | None = None


def rounded(value: float) -> float:
    """A length to 12 significant digits: the same mesh whatever units the scene came in."""
    return float(f"{value:.12g}")


def choose(a: float, height: float, width: float, dim: int, order: int, given: Given, *, edge: float | None,
           last: float | None = None, round_radius: float | None = None, keenness: float = 1.0) -> Sizes:  # fmt: skip
    """Sizes for an expected contact radius a in a body of the given height and width [length].

    last: the radius to expect at the last step, if there is contact [length].
    round_radius: of a curved wall, which straight facets follow [length].
    keenness: how much finer than usual a punch's edge must be, in two dimensions; in three it would cost too much.
    """
    fine = rounded(given.h_contact or min(a / PER_RADIUS[dim, order], height / 4))  # what follows must not know
    wide = min(max(a / width - 0.5, 0.0), 0.5)  # who chose it. Wide contacts feel the corners at the base
    coarse = (0.25 - 0.3 * wide) * max(height, width) / (1 if order == 2 else 4)
    far = given.h_far or max(fine, min(coarse, round_radius / PER_WALL_RADIUS) if round_radius else coarse)
    patch = PATCH * a + 2 * fine
    ratio = EDGE_RATIO[dim] * (keenness if dim == 2 else 1.0)
    h_edge = rounded(given.h_edge or fine / ratio) if edge is not None else None
    axis = rounded(given.h_axis or (fine if given.h_contact else fine * max((last or a) / a, SMALLEST)))
    grading = rounded(given.grading or GRADING[order])
    return Sizes(fine, rounded(far), rounded(patch), order, grading, edge, h_edge,
                 h_axis=axis if axis < fine else None, a=rounded(a), keenness=keenness)  # fmt: skip


def in_words(error: float) -> str:
    """A relative error of the force in words."""
    if error >= 1:
        return "more than there is of it"
    return "tens of per cent" if error >= 0.2 else f"about {100 * error:.1g} %"
