"""The most deformed points of a body, for messages about inverted elements."""

from __future__ import annotations

from dataclasses import dataclass

from indent_sim.scene.scene import Scene


@dataclass(frozen=True)
class InvertedElements:
    """Smallest volume ratio and largest principal stretch of a body at its quadrature points.

    Attributes
    ----------
    J : float
        Smallest volume ratio det F; elements are inverted where it is negative.
    X : tuple of float
        Undeformed position of the point with the smallest J [length].
    stretch : float
        Largest principal stretch.
    X_stretched : tuple of float
        Undeformed position of the point with the largest stretch [length].
    """

    J: float
    X: tuple[float, ...]
    stretch: float
    X_stretched: tuple[float, ...]

    def message(self, scene: Scene) -> str:
        """Return both extremes and their positions as text, in the user's length unit."""
        axes = ", ".join(scene.physics.domain.kinematics.axes)

        def format_point(X: tuple[float, ...]) -> str:
            return ", ".join(f"{x * scene.physics.scales.length:.4g}" for x in X)

        return (
            f", where the smallest J is {self.J:.3g} at ({axes}) = ({format_point(self.X)}) and "
            f"the largest stretch is {self.stretch:.3g} at ({format_point(self.X_stretched)})"
        )

    def merge_extremes(self, second: InvertedElements) -> InvertedElements:
        """Return the extremes over two regions or ranks."""
        J, X = min((self.J, self.X), (second.J, second.X))
        stretch, X_stretched = max(
            (self.stretch, self.X_stretched), (second.stretch, second.X_stretched)
        )
        return InvertedElements(J, X, stretch, X_stretched)
