"""Element sizes from the accuracy asked for, and the error to expect of them.

One number rules the discretisation: the elements n in the contact radius of every step. All else follows it, so that
no part dominates the error: sizes grow with the distance from the axis as the contact edge passes there, the far size
falls as 1/n, their growth outside the contact as n^-EASING, and towards a punch's edge the elements shrink as n^-RATE.
The force then converges as n^-RATE.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

PRESETS = {"fast": 0.05, "balanced": 0.01, "accurate": 0.001}
# The error bar of the force is about CONSTANT n^-RATE at the worst step (by dim), as
# `python -m pytest -m verify tests/physics/test_accuracy.py -s` prints it for every scene
CONSTANT = {2: 0.65, 3: 0.33}
RATE = 2.5
BLUNT = 2.0  # with fewer elements than this the error grows no more as n^-RATE
FEWEST = {2: 5.0, 3: 4.6}  # elements in the contact radius, by dim: two meshes much coarser say nothing
MOST = 1000.0
GROWTH = {2: 1.0, 3: 0.6}  # grading times n^EASING, by dim
EASING = RATE / 4  # growth^4 is its error of the energy
STEEPEST = 0.5
FAR = {2: 2.0, 3: 1.25}  # h_far n over the larger of height and width, by dim
CONFINED = 1.6  # times as many elements where a layer that hardly compresses is squeezed: its force scatters more
THIN = 4.0  # at most this many thicknesses over n
EDGE = {2: 0.3, 3: 3.0}  # h_edge n^RATE over the punch's radius, by dim
SMALLEST = {2: 0.01, 3: 0.2}  # contact radius that still gets n elements, of the largest one, by dim
SINKING = 1.5  # per cent of force for a per cent of depth that a penalty of mean pressure / epsilon_n takes
ENFORCEMENT = 0.2  # share of the error that a penalty may take where its stiffness is left to the program


@dataclass(frozen=True)
class SettledSizes:
    """Sizes [length] and grading that the config or an accuracy settles; None: left to `sizing.choose`."""

    h_contact: float | None = None
    h_axis: float | None = None
    h_edge: float | None = None
    h_corner: float | None = None
    h_far: float | None = None
    grading: float | None = None


@dataclass(frozen=True)
class Fineness:
    """Elements n in every contact radius from `smallest` to `largest` [length], chosen for a relative target.

    compliance [pressure/length]: a penalty's relative error is compliance / epsilon_n at the worst step.
    """

    target: float
    n: float
    smallest: float
    largest: float
    compliance: float
    dim: int
    stiffness_given: bool = False  # the user's penalty stiffness, whose error no mesh can make smaller
    refinements: int = 0  # of a mesh from a file, which knows no sizes between

    @property
    def error(self) -> float:
        """The relative error bar to expect of the mesh."""
        return float(CONSTANT[self.dim] * self.n**-RATE)

    @property
    def penalty(self) -> float:
        """The epsilon_n [pressure/length] of a penalty that takes its share of the error."""
        return self.compliance / (ENFORCEMENT * min(self.error, self.target))

    def why(self, length: float) -> str:
        """The reason in words; `length`: the scene's unit in the user's."""
        radii = [f"{radius * length:.3g}" for radius in sorted({self.smallest, self.largest})]
        return (
            f"{self.n:.3g} elements in the contact radius of every step ({' to '.join(radii)}), by the measured trade; "
            "the error is estimated, and the mesh refined until it is met"
        )

    def sizes(self, height: float, width: float, edge: float | None, round_radius: float | None,
              keenness: float) -> SettledSizes:  # fmt: skip
        """The sizes for a body of this height and width [length]; see `sizing.choose`."""
        n = self.n
        fine = min(self.largest / n, height * min(1.0, THIN / n))
        return SettledSizes(
            h_contact=fine,
            h_axis=min(self.smallest / n, fine) if edge is None else None,
            h_edge=min(edge * EDGE[self.dim] * n**-RATE / keenness, fine) if edge is not None else None,
            h_far=max(fine, min(FAR[self.dim] / n * max(height, width), (round_radius or float("inf")) / n)),
            grading=min(STEEPEST, GROWTH[self.dim] * n**-EASING),
        )


def target_of(accuracy: float | str | None) -> float | None:
    """The relative error that a preset stands for."""
    return PRESETS[accuracy] if isinstance(accuracy, str) else accuracy


def fading(n: float) -> float:
    """How the error falls with the elements in the contact radius, up to a factor that is the scene's own."""
    return float((n**4 + BLUNT**4) ** (-RATE / 4))


def elements_for(target: float, dim: int, confined: bool = False) -> float:
    """Elements in the contact radius of every step whose error bar is expected within the target.

    confined: a contact as wide as a layer that hardly compresses is thick, or wider.
    """
    n = (CONFINED if confined else 1.0) * (CONSTANT[dim] / target) ** (1 / RATE)
    return min(max(n, FEWEST[dim]), MOST)


def steepness(decay: tuple[float, float]) -> float:
    """Times as many elements where the waves of a surface pressure fade so much more slowly or faster with the depth
    than in an isotropic body: the error is about as many times as large."""
    slow, fast = decay
    return float(max(1 / slow, fast, 1.0) ** (1 / RATE))


def fineness_of(target: float, elements: float | None, contacts: Sequence[tuple[float, float, float]], dim: int,
                confined: bool, stiffness_given: bool, steeper: float = 1.0) -> Fineness:  # fmt: skip
    """The fineness for a relative target, or with that many elements in the radius.

    contacts: (depth, expected contact radius, mean pressure) of the shallowest and the deepest step in contact.
    steeper: times as many elements as in an isotropic body, see `steepness`.
    """
    largest = max(a for _, a, _ in contacts)
    smallest = max(min(a for _, a, _ in contacts), SMALLEST[dim] * largest)
    compliance = max(SINKING * pressure / delta for delta, _, pressure in contacts)
    n = elements or min(steeper * elements_for(target, dim, confined), MOST)
    return Fineness(target, n, smallest, largest, compliance, dim, stiffness_given)
