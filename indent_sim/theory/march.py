"""LayerContact: the contact of a layer theory at one depth or force after another, or at many at
once.

Once the powers of Hertz's contact are taken out of it, whatever belongs to a contact of the size a is an analytic
function of a,
    delta = h g d(a),  F = E* h^n a^(n-1) g f(a),  dF/ddelta = E* h^(n-1) a^(n-1) s(a),
    U = E* h^(n+1) a^(n-1) g^2 u(a),  p_max = E* (g/a) p(a),
with g(a) the tip's profile, a and g in units of h, n = 2 (n = 1 in plane strain). Chebyshev polynomials through a few
sizes meet it to rounding, which their last coefficients tell; where these are not small nothing is interpolated: a tip
with kinks, a pressure whose largest place wanders.
Source: Trefethen (2013), Approximation Theory and Approximation Practice, chapters 3 and 8.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from indent_sim.theory.profiles import Tip
from indent_sim.theory.roots import first_guess, increasing_root, next_guess, power_law_step
from indent_sim.theory.solution import COARSE, MAX_SLENDERNESS, Solution, check_contact, no_contact
from indent_sim.theory.stack import Stack

SIGN_RINGS = 40  # of a contact, in which the sign of the pressure is looked at
TENSION = 1e-6  # of the force: less is a lost digit
# Depths from which on a few sizes may tell all of them, and most sizes for each: a search of one
# takes four or five
FEWEST_DEPTHS = 8
SIZES_PER_DEPTH = 1.9
COUNTS = (8, 15, 29, 57, 113)  # sizes, those of each among those of the next
# relative size of that many last coefficients once a polynomial has converged
CONVERGED = 2e-13
LAST = 2
NOT_FOUND = 1e-11  # relative, of a depth or force that a search has not found
DOUBT = 2.0  # sizes by which what a few foretell may be too many
# relative steps: the last of a search, the least of a secant; rounds
SAME_SIZE = 1e-11
LEAST_MOVED = 1e-10
ROUNDS = 30
LOOKED_AT = 7  # every so many sizes it is looked where the largest pressure is
# in a contact, where its largest pressure is looked for: it changes within h
FEW_PLACES = 21
PLACES_PER_A = 8.0
END_MARGIN = 0.05  # of the sizes at both ends: what the first step of a search may be off
# columns of what belongs to a contact
OF_DEPTH = 0
OF_FORCE = 1
Sizes = TypeVar("Sizes", float, np.ndarray)


def pointwise(
    value: Callable[..., np.ndarray], contact: LayerContact, *known: Any
) -> Callable[[Any], np.ndarray]:
    """value(contact, *known, |x|/h) of places (n,), as a function of places x [L], a number or an
    array.
    """
    return partial(_at, value, contact, known)


def _at(
    value: Callable[..., np.ndarray], contact: LayerContact, known: tuple[Any, ...], x: Any
) -> np.ndarray:
    x = np.abs(np.asarray(x, dtype=float)) / contact.h
    return value(contact, *known, np.atleast_1d(x).ravel()).reshape(x.shape)[()]


@dataclass(frozen=True)
class LayerContact(ABC):
    """A layer, or a stack of them, under a tip.

    The unit of length of all contact sizes is h [L], the thickness of the top layer. wall: the
    distance of frictionless side walls [h], infinity for none. E_star [F/L^2]: of the top layer.
    """

    tip: Tip
    scaled: Stack  # in units of its top layer
    E_star: float
    h: float
    wall: float

    dimensions: ClassVar[int] = 2  # of the contact area

    @classmethod
    def on(cls, tip: Tip, stack: Stack, wall: float | None = None) -> Self:
        """The contact of a tip with a stack, infinitely wide or between frictionless walls at the
        distance `wall` [L]. ValueError for a wall around a half-space, which would sink without
        end.
        """
        return cls(tip, stack.in_units_of_top(), stack.E_star, stack.h, stack.wall(wall))

    @abstractmethod
    def profile(self, x: np.ndarray) -> np.ndarray:
        """An increasing shape function of the tip, about the depth [h] of a contact of size x."""

    @abstractmethod
    def at(self, a: float) -> Any:
        """The linear problem of the contact size a; its `touch` is the depth [h] of a smooth tip
        with this contact.
        """

    @abstractmethod
    def solution(self, delta: float, a: float, found: Any = None) -> Solution:
        """The contact of size a at the depth delta [L]; found: what `at` says of that size, where
        it is known.
        """

    def area(self, a: Sizes) -> Sizes:
        """Area [L^2] of a disc of radius a, in plane strain the width [L] of a band."""
        return math.pi * (a * self.h) ** 2 if self.dimensions == 2 else 2.0 * a * self.h

    @staticmethod
    def stretched(a: Sizes) -> Sizes:
        """The variable in which what belongs to a contact of size a is smooth between two sizes."""
        return a

    @staticmethod
    def size_at(x: float) -> float:
        """The size with that variable."""
        return x

    def largest(self) -> float:
        """The contact size that cannot be reached."""
        return min(self.wall, self.tip.reach / self.h, MAX_SLENDERNESS)

    def several(self, sizes: Sequence[float], largest: float) -> Sequence[Any]:
        """What `at` says of several contact sizes, none above the largest [h]."""
        return [self.at(a) for a in sizes]

    def numbers(self, sizes: np.ndarray, found: Sequence[Any]) -> np.ndarray:
        """Depth, force, stiffness and energy (4, sizes) [L, F, F/L, F L] of contacts of a smooth
        tip; found: what `at` says of their sizes [h].
        """
        known = [self.touching(a, one) for a, one in zip(map(float, sizes), found, strict=True)]
        return np.array([[one.delta, one.force, one.stiffness, one.energy] for one in known]).T

    def middle_pressures(self, sizes: np.ndarray, found: Sequence[Any]) -> np.ndarray:
        """Pressures [F/L^2] in the middle of contacts of a smooth tip; as above."""
        middle = np.zeros(1)
        pairs = zip(map(float, sizes), found, strict=True)
        return np.array([float(self.touching(a, one).pressure(middle)[0]) for a, one in pairs])

    def pressures(self, sizes: np.ndarray, found: Sequence[Any], places: int) -> np.ndarray:
        """Pressures (sizes, places) [F/L^2] at even steps from the middle to before the edge; as
        above.
        """
        shares = np.linspace(0.0, 1.0, places, endpoint=False)
        pairs = zip(map(float, sizes), found, strict=True)
        return np.array([self.touching(a, one).pressure(a * self.h * shares) for a, one in pairs])

    def touching(self, a: float, found: Any = None) -> Solution:
        """The contact of size a of a smooth tip; found: what `at` says of that size, where it is
        known.
        """
        found = found or self.at(a)
        return self.solution(found.touch * self.h, a, found)

    def curve(self, deltas: Sequence[float]) -> list[Solution]:
        """One Solution per depth [L]; none for a depth <= 0.

        Raises ValueError when the contact would reach the wall, the end of the tip, or a/h = 100.

        Those of many depths are interpolated where that is exact to rounding, else each is sought
        from its neighbour's.
        """
        for delta in deltas:
            check_contact(delta, self.tip.edge, self.h, self.wall * self.h)
        depths = sorted({delta for delta in deltas if delta > 0.0})
        sampled = self._sampled(depths[0], depths[-1], len(depths)) if depths else None
        if sampled is None:
            return self._one_by_one(deltas)
        known = dict(zip(depths, sampled.at(depths), strict=True))
        return [known.get(delta) or no_contact(delta) for delta in deltas]

    def under(self, forces: Sequence[float]) -> list[Solution]:
        """One Solution per force [F], none for a force <= 0; otherwise as `curve`."""
        pushes = sorted({force for force in forces if force > 0.0})
        sampled = None
        if len(pushes) >= FEWEST_DEPTHS:
            sampled = self._sampled(self.depth(pushes[0]), self.depth(pushes[-1]), len(pushes))
        found = (
            sampled.under(pushes)
            if sampled
            else self._one_by_one([self.depth(force) for force in pushes])
        )
        known = dict(zip(pushes, found, strict=True))
        return [known.get(force) or no_contact(0.0) for force in forces]

    def _sampled(self, first: float, last: float, count: int) -> SampledContacts | None:
        """The contacts between two depths, from which so many are wanted; None where they are few,
        or no polynomial meets them.
        """
        if count < FEWEST_DEPTHS or self.tip.edge is not None or self.tip.breaks:
            return None
        most = int(SIZES_PER_DEPTH * count)
        small, large = self._about(first, last)
        if large < self.largest():
            found = SampledContacts.between(self, small, large, most)
            if found is None or found.holds(first, last):
                return found
        small, large = (one.a / self.h for one in self._one_by_one([first, last]))
        return SampledContacts.between(self, small, large, most) if small < large else None

    def _about(self, first: float, last: float) -> tuple[float, float]:
        """A little less and a little more than the contact sizes [h] at two depths [L]: the first
        step of a search.
        """
        depths = first / self.h, last / self.h
        sizes = [first_guess(self.profile, depth, self.largest()) for depth in depths]
        found = zip(sizes, self.several(sizes, max(sizes)), depths, strict=True)
        small, large = (power_law_step(a, one.touch, depth) for a, one, depth in found)
        return small * (1.0 - END_MARGIN), large * (1.0 + END_MARGIN)

    def _one_by_one(self, deltas: Sequence[float]) -> list[Solution]:
        solutions: list[Solution] = []
        known: list[tuple[float, float]] = []
        for delta in deltas:
            if delta <= 0.0:
                solutions.append(no_contact(delta))
            elif self.tip.edge is not None:
                solutions.append(self.solution(delta, self.tip.edge / self.h))
            else:
                depth = delta / self.h
                start = next_guess(known, depth) or first_guess(self.profile, depth, self.largest())
                a = increasing_root(lambda a: self.at(a).touch, depth, start, self.largest())
                known.append((depth, a))
                solutions.append(self.solution(delta, a))
        return solutions

    def up_to(self, deepest: Solution, count: int) -> list[Solution]:
        """Solutions up to a known one, at even steps of the contact size, which is not sought then;
        of the depth under an edge.
        """
        steps = np.arange(1, count + 1) / count
        if self.tip.edge is not None:
            return self.curve(list(deepest.delta * steps))
        return [self.touching(a) for a in deepest.a / self.h * steps]

    def depth(self, force: float) -> float:
        """The depth [L] at which the force is this one [F] > 0, found by the contact's size; errors
        as for `curve`.
        """
        if self.tip.edge is not None:
            return force / self.curve([self.h])[0].stiffness
        start = first_guess(self.profile, force / (self.E_star * self.h**2), self.largest())
        a = increasing_root(lambda a: self.touching(a).force, force, start, self.largest())
        return float(self.at(a).touch * self.h)

    def tension(self, solution: Solution) -> float:
        """The share of the force that the tip would have to pull with: the sum of negative pressure
        over the force.

        The contact of theory is whole. A stiff layer on a soft one bends away from the middle of a
        punch, and what is pushed alone has a smaller contact and a little less force.
        """
        if len(self.scaled.plies) == 1 or solution.force <= 0:
            return 0.0
        at = (np.arange(SIGN_RINGS) + 0.5) / SIGN_RINGS
        share = self.dimensions * at ** (self.dimensions - 1) / SIGN_RINGS
        pull = (
            -float(share @ np.minimum(solution.pressure(at * solution.a), 0.0))
            * solution.area
            / solution.force
        )
        return pull if pull > TENSION else 0.0


@dataclass(frozen=True, eq=False)
class SampledContacts:
    """The contacts of a theory between two sizes, which was asked for them at a few sizes [h],
    increasing.
    """

    contact: LayerContact
    sizes: np.ndarray
    found: Sequence[Any]  # what `LayerContact.at` says of each

    @classmethod
    def between(
        cls, contact: LayerContact, first: float, last: float, most: int
    ) -> SampledContacts | None:
        """Contacts of a smooth tip from `first` to `last` [h]; None where `most` sizes do not
        determine them.
        """
        known: dict[float, Any] = {}
        needed = 0.0
        for count in (count for count in COUNTS if count <= most):
            if count < needed - DOUBT:
                continue
            sizes = list(
                map(
                    contact.size_at,
                    _places(contact.stretched(first), contact.stretched(last), count),
                )
            )
            new = [a for a in sizes if a not in known]
            known |= zip(new, contact.several(new, sizes[-1]), strict=True)
            found = cls(contact, np.array(sizes), [known[a] for a in sizes])
            left = _left(found._reduced)
            if left <= CONVERGED:
                return found
            needed = (
                LAST + (count - LAST) * math.log(CONVERGED) / math.log(left)
                if left < 1.0
                else math.inf
            )
        return None

    def at(self, deltas: Sequence[float]) -> list[Solution]:
        """The contacts at depths [L] between those of the two sizes."""
        return self._contacts(self._sizes(deltas, OF_DEPTH), deltas)

    def under(self, forces: Sequence[float]) -> list[Solution]:
        """The contacts under forces [F] between those of the two sizes."""
        a = self._sizes(forces, OF_FORCE)
        return self._contacts(a, list(map(float, self._values(a)[OF_DEPTH])))

    def holds(self, first: float, last: float) -> bool:
        """Whether two depths [L] are between those of the sizes."""
        return bool(self._known[OF_DEPTH, 0] <= first and last <= self._known[OF_DEPTH, -1])

    @cached_property
    def solutions(self) -> list[Solution]:
        """The contacts of the sizes."""
        return [
            self.contact.touching(a, one)
            for a, one in zip(map(float, self.sizes), self.found, strict=True)
        ]

    def at_size(self, a: float) -> Solution:
        """The contact of a size [h], solved for."""
        return self.contact.touching(float(a))

    def _contacts(self, a: np.ndarray, deltas: Sequence[float]) -> list[Solution]:
        contact = self.contact
        peaks = _Peaks(self, a)
        found = []
        _, force, stiffness, energy = (list(map(float, value)) for value in self._values(a))
        for i, (size, delta) in enumerate(zip(map(float, a), deltas, strict=True)):
            pressure, u_z = (
                partial(_solved, contact, delta, size, name) for name in ("pressure", "u_z")
            )
            numbers = (
                float(delta),
                force[i],
                size * contact.h,
                contact.area(size),
                energy[i],
                stiffness[i],
            )
            found.append(Solution(*numbers, pressure=pressure, u_z=u_z, peak=partial(peaks.of, i)))
        return found

    def _values(self, a: np.ndarray) -> np.ndarray:
        """Depth, force, stiffness and energy of contacts of sizes (4, len(a)) [L, F, F/L, F L]."""
        return self.polynomials(self._reduced, a) * self._powers(a)

    def _powers(self, a: np.ndarray) -> np.ndarray:
        """What is taken out of depth, force, stiffness and energy (4, len(a)) [L, F, F/L, F L]."""
        contact = self.contact
        h = self.contact.h
        g = h * contact.profile(a)
        stiffness = contact.E_star * (a * h) ** (contact.dimensions - 1)
        return np.array([g, stiffness * g, stiffness, stiffness * g * g])

    @cached_property
    def _reduced(self) -> np.ndarray:
        """d, f, s and u at the sizes (4, sizes)."""
        return np.asarray(self._known / self._powers(self.sizes))

    @cached_property
    def _known(self) -> np.ndarray:
        """Depth, force, stiffness and energy at the sizes (4, sizes) [L, F, F/L, F L]."""
        return self.contact.numbers(self.sizes, self.found)

    def polynomials(self, values: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Polynomials through values (columns, sizes), at other sizes (columns, len(a))."""
        x = self.contact.stretched(a)
        (first, *_, last) = self.contact.stretched(self.sizes)
        angle = np.arccos(
            np.minimum(np.maximum((2.0 * x - first - last) / (last - first), -1.0), 1.0)
        )
        return (
            np.cos(np.multiply.outer(angle, np.arange(values.shape[1]))) @ _coefficients(values)
        ).T

    def _sizes(self, asked: Sequence[float], column: int) -> np.ndarray:
        """The sizes [h] at which a column of `_values` is what is asked for: secants between
        logarithms, which set out from chords between the known sizes.
        """
        along = np.log(asked)
        least = self.sizes[0]
        most = self.sizes[-1]
        known = np.log(self.sizes)
        at = np.log(self._known[column])
        chord = np.clip(np.searchsorted(at, along) - 1, 0, at.size - 2)
        x = np.interp(along, at, known)
        exponent = (np.diff(at) / np.diff(known))[chord]
        before: tuple[np.ndarray, np.ndarray] | None = None
        for _ in range(ROUNDS):
            off = (
                np.log(self._values(np.minimum(np.maximum(np.exp(x), least), most))[column]) - along
            )
            if before is not None:
                moved = x - before[0]
                changed = off - before[1]
                tells = np.abs(moved) > LEAST_MOVED
                exponent = np.where(tells, changed / np.where(tells, moved, 1.0), exponent)
            before = (x, off)
            x = x - off / exponent
            if np.abs(x - before[0]).max() <= SAME_SIZE:
                break
        a = np.minimum(np.maximum(np.exp(x), least), most)
        if not np.all(np.abs(self._values(a)[column] - asked) <= NOT_FOUND * np.abs(asked)):
            raise ArithmeticError("contact sizes were not found for all depths or forces at once")
        return a


class _Peaks:
    """The largest pressures of contacts, of all by a polynomial where one meets them, else each
    sought.
    """

    def __init__(self, sampled: SampledContacts, a: np.ndarray):
        self._sampled = sampled
        self._a = a

    def of(self, i: int) -> float:
        """The largest pressure [F/L^2] of the i-th contact."""
        return (
            float(self._known[i])
            if self._known is not None
            else self._sought(self._sampled.at_size(self._a[i]))
        )

    @property
    def _are_in_the_middle(self) -> bool:
        """Whether every LOOKED_AT-th size has it there, where an even pressure is flat: then all
        are taken to.
        """
        sampled = self._sampled
        some = slice(None, None, LOOKED_AT)
        places = min(COARSE, FEW_PLACES + math.ceil(PLACES_PER_A * sampled.sizes[-1]))
        with np.errstate(all="ignore"):
            p = sampled.contact.pressures(sampled.sizes[some], sampled.found[some], places)
        return bool(np.all((p[:, 0] >= p.max(axis=1)) & (p[:, 1] > p[:, 2])))

    def _sought(self, solution: Solution) -> float:
        places = FEW_PLACES + math.ceil(PLACES_PER_A * solution.a / self._sampled.contact.h)
        return solution.largest_pressure(min(COARSE, places))

    @cached_property
    def _known(self) -> np.ndarray | None:
        """Those of all contacts; None where no polynomial meets them."""
        sampled = self._sampled
        contact = self._sampled.contact
        if self._are_in_the_middle:
            found = contact.middle_pressures(sampled.sizes, sampled.found)[None]
        elif self._a.size < sampled.sizes.size:
            return None
        else:
            found = np.array([[one.largest_pressure() for one in sampled.solutions]])
        if not np.isfinite(found).any():
            return np.full(self._a.size, math.nan)
        unit = [contact.E_star * contact.profile(a) / a for a in (sampled.sizes, self._a)]
        if not np.isfinite(found).all() or _left(found / unit[0]) > CONVERGED:
            return None
        return np.asarray(sampled.polynomials(found / unit[0], self._a)[0] * unit[1])


def _solved(contact: LayerContact, delta: float, a: float, name: str, r: Any) -> Any:
    """Pressure or u_z of a contact at places r, solved for when they are asked for."""
    return getattr(contact.solution(delta, a), name)(r)


def _places(first: float, last: float, count: int) -> list[float]:
    """Chebyshev's points of the second kind, in order; every second one is among those of half as
    many.
    """
    at = 0.5 * (first + last) - 0.5 * (last - first) * np.cos(
        math.pi * np.arange(count) / (count - 1)
    )
    return [first, *map(float, at[1:-1]), last]


@lru_cache(maxsize=len(COUNTS))
def _transform(count: int) -> np.ndarray:
    """From values at Chebyshev's points to coefficients (count, count)."""
    k = np.arange(count)
    n = count - 1
    ends = np.where((k == 0) | (k == n), 0.5, 1.0)
    return 2.0 / n * ends[:, None] * np.cos(math.pi * np.outer(k, n - k) / n) * ends


def _left(values: np.ndarray) -> float:
    """The last coefficients of polynomials through values (columns, sizes), over the largest one of
    each.
    """
    coefficients = np.abs(_coefficients(values))
    return float((coefficients[-LAST:].max(axis=0) / coefficients.max(axis=0)).max())


def _coefficients(values: np.ndarray) -> np.ndarray:
    """Coefficients (sizes, columns) of polynomials through values (columns, sizes)."""
    return _transform(values.shape[1]) @ values.T
