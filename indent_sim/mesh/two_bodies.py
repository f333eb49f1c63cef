"""Two bodies on one mesh: an axisymmetric body and the soft tip above it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from indent_sim.mesh.model_domain import ModelDomain, Region

# Prefix of the names of the surfaces of the tip.
TIP_PREFIX = "tip_"


@dataclass(frozen=True)
class TwoBodyDomain(ModelDomain):
    """Domain of a body whose mesh also contains the soft tip, as its last region.

    Outline, height and supports are those of the body. The tip has supports of its own: it is
    bonded to a rigid holder above, and its axis is that of the body.

    Attributes
    ----------
    tip
        The domain of the tip, upside down.
    """

    tip: ModelDomain = field(kw_only=True)

    @classmethod
    def join(cls, body: ModelDomain, tip: ModelDomain, region: Region) -> TwoBodyDomain:
        """Return the domain of both bodies; `region` is the tip's region in units of the body."""
        parts = {part.name: getattr(body, part.name) for part in fields(ModelDomain)}
        return cls(**(parts | {"regions": (*body.regions, region)}), tip=tip)

    @property
    def constrained_components(self) -> tuple[tuple[int, str], ...]:
        """Displacement components that supports of body and tip constrain, with their surfaces."""
        return (
            *super().constrained_components,
            *(
                (component, TIP_PREFIX + surface)
                for component, surface in self.tip.constrained_components
            ),
        )

    @property
    def interfaces(self) -> tuple[float, ...]:
        """Levels [length] of the interfaces between the layers of the body in ascending order."""
        layers = [region for region in self.regions[:-1] if region.inclusion is None]
        return tuple(region.bottom for region in reversed(layers[:-1]))
