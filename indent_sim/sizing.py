"""Element sizes from the expected contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Elements per contact radius that keep the force within 0.3 % at the last step (measured on HERTZ axi and cube)
PER_RADIUS = {(2, 2): 10.0, (2, 1): 40.0, (3, 2): 5.0, (3, 1): 16.0}  # (dim, order)
GRADING = {2: 0.2, 1: 0.1}  # growth of the size per unit distance, by order
PER_WALL_RADIUS = 5.0  # elements per radius of a curved wall: its polygon encloses 0.7 % less than the circle
PATCH = 1.15  # the fine patch reaches this far beyond the expected contact radius
ENOUGH = {2: 3.0, 1: 10.0}  # elements per contact radius below which results are doubtful, by order
SMALLEST = 1e-4  # contact radius of the last step, of the largest one, that still gets as many elements
EDGE_RATIO = {2: 20.0, 3: 4.0}  # refinement towards a punch's sharp edge, where the pressure is singular


@dataclass(frozen=True)
class Sizes:
    """Element sizes [length] and order.

    h_contact inside `patch` of the tip's axis, growing by `grading` per unit distance outside it up to h_far;
    around a sharp edge at radius `edge` it shrinks to h_edge. Where h_axis is given, sizes inside the expected contact
    radius `a` are the share of it that the distance from the axis is, but at least h_axis: so a contact of any radius
    down to a h_axis/h_contact finds as many elements as the last one.
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

    @property
    def typical(self) -> float:
        """Between the sizes at the axis and at the edge of the contact, in the geometric mean [length]."""
        return self.h_contact if self.h_axis is None else float(np.sqrt(self.h_axis * self.h_contact))

    @property
    def smallest(self) -> float:
        """The size at the axis [length]."""
        return self.h_axis or self.h_contact

    @property
    def slope(self) -> float:
        """Growth of the size per unit distance from the axis, inside the contact, where there is one."""
        return self.h_contact / self.a

    def at(self, r: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """The element size [length] at distance r from the tip's axis and a depth below the surface."""
        near = self.h_contact if self.h_axis is None else np.clip(self.slope * r, self.h_axis, self.h_contact)
        size = near + self.grading * np.hypot(np.maximum(r - self.patch, 0.0), depth)
        if self.edge is not None and self.h_edge is not None:
            size = np.minimum(size, self.h_edge + self.grading * np.hypot(r - self.edge, depth))
        return np.minimum(size, self.h_far)

    def force_doubt(self, a: float) -> float:
        """The relative error of the force to fear with so few elements in the expected contact radius; 0 with enough.

        Measured on a layer (axisymmetric, all methods, quadratic elements): at most 0.3, 0.9, 2.3, 2.4, 5.5, 15, 20 and
        117 % with n = 3, 2, 1.5, 1, 0.7, 0.5, 0.3 and 0.1 elements: below 7/n^2 %.
        """
        n = a / float(self.at(np.array(a), np.array(0.0)))
        if self.edge is not None or n >= ENOUGH[self.order]:  # an edge: the contact radius is known, and refined
            return 0.0
        return 0.25 / min(n, n**2) if self.order == 1 else 0.07 / n**2

    def doubts(self, a: float, penalty: bool) -> list[str]:
        """What too few elements in the expected contact radius a will do to the results, in words.

        Measured on HERTZ (axisymmetric, strip, cube) with n = 0.7 to 20 elements in a: the force is wrong by up to
        25/n % with linear elements (too high); a by 3 % with quadratic and 8 % with linear elements, with penalty and
        quadratic elements by 20 %. Penalty with linear elements finds an a that is too small: by 60 % (n = 1),
        22 to 39 % (5), 12 to 25 % (10), 3 to 7 % (20).
        """
        n, doubts = a / self.h_contact, []
        if self.edge is not None:  # the contact radius is known, and its edge refined
            return []
        if n < ENOUGH[self.order]:
            likely, of_a = self.force_doubt(a), 20 if penalty else {1: 8, 2: 3}[self.order]
            doubts.append(
                f"only {n:.2g} elements in the expected contact radius: the force may be wrong by {in_words(likely)}, "
                f"a by up to {of_a} %; give h_contact at most {1 / ENOUGH[self.order]:.2g} of the contact radius"
            )
        if penalty and self.order == 1:
            doubts.append(
                f"penalty with linear elements underestimates a, here by up to {min(60, 250 / n):.0f} %; "
                "use order: 2 or another contact method"
            )
        return doubts


@dataclass(frozen=True)
class Given:
    """Sizes [length] and grading that are settled; None: left to `choose`."""

    h_contact: float | None = None
    h_axis: float | None = None
    h_edge: float | None = None
    h_far: float | None = None
    grading: float | None = None


def rounded(value: float) -> float:
    """A length to 12 significant digits: the same mesh whatever units the scene came in."""
    return float(f"{value:.12g}")


def choose(a: float, height: float, width: float, dim: int, order: int, given: Given, *, edge: float | None,
           last: float | None = None, round_radius: float | None = None) -> Sizes:  # fmt: skip
    """Sizes for an expected contact radius a in a body of the given height and width [length].

    last: the radius to expect at the last step, if there is contact [length].
    round_radius: of a curved wall, which straight facets follow [length].
    """
    fine = rounded(given.h_contact or min(a / PER_RADIUS[dim, order], height / 4))  # what follows must not know
    wide = min(max(a / width - 0.5, 0.0), 0.5)  # who chose it. Wide contacts feel the corners at the base
    coarse = (0.25 - 0.3 * wide) * max(height, width) / (1 if order == 2 else 4)
    far = given.h_far or max(fine, min(coarse, round_radius / PER_WALL_RADIUS) if round_radius else coarse)
    patch = PATCH * a + 2 * fine
    h_edge = rounded(given.h_edge or fine / EDGE_RATIO[dim]) if edge is not None else None
    axis = rounded(given.h_axis or (fine if given.h_contact else fine * max((last or a) / a, SMALLEST)))
    grading = rounded(given.grading or GRADING[order])
    return Sizes(fine, rounded(far), rounded(patch), order, grading, edge, h_edge,
                 h_axis=axis if axis < fine else None, a=rounded(a))  # fmt: skip


def in_words(error: float) -> str:
    """A relative error of the force in words."""
    if error >= 1:
        return "more than there is of it"
    return "tens of per cent" if error >= 0.2 else f"about {100 * error:.1g} %"
