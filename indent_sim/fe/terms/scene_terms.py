"""The terms of a scene, matter and touch, and the fields that they need."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from indent_sim.fe.discrete_body import Body, Field
from indent_sim.fe.terms import flow
from indent_sim.fe.terms.contact import friction, nodal, traction
from indent_sim.fe.terms.contact.drag import Drag
from indent_sim.fe.terms.contact.friction import Friction
from indent_sim.fe.terms.contact.nodal import NodalContact
from indent_sim.fe.terms.contact.traction import Traction
from indent_sim.fe.terms.flow import Flow, Valve
from indent_sim.fe.terms.relaxing import Relaxing
from indent_sim.fe.terms.strain import Strain, pressures
from indent_sim.fe.terms.surface_tension import SurfaceTension
from indent_sim.fe.terms.term import Term
from indent_sim.fe.terms.wall import Wall
from indent_sim.scene.scene import Scene


@dataclass(frozen=True)
class Matter:
    """The terms of a body without contact: strain energies, first of the region under the tip, a
    curved wall, the fluid in its pores with its way out, and the tension of its surface.
    """

    strains: tuple[Strain, ...]
    walls: tuple[Wall, ...]
    flow: Flow | None = None
    valve: Valve | None = None
    tension: SurfaceTension | None = None

    def __iter__(self) -> Iterator[Term]:
        yield from (
            term
            for term in (*self.strains, *self.walls, self.flow, self.valve, self.tension)
            if term
        )


@dataclass(frozen=True)
class Touch:
    """The terms of the tip: its pressure, by the scene's contact method, its friction where there
    is some, and what holds the surface back while it snaps to a tip that adheres.
    """

    pressure: Traction | NodalContact
    friction: Friction | None = None
    drag: Drag | None = None

    def __iter__(self) -> Iterator[Term]:
        yield from (term for term in (self.pressure, self.friction, self.drag) if term)


def matter_of(body: Body) -> Matter:
    """The terms of a scene's body."""
    physics = body.scene.physics
    strains = tuple(
        (Relaxing if region.relaxing else Strain)(body, region) for region in physics.part.regions
    )
    walls = (Wall(body),) if physics.wall_stiffness else ()
    tension = SurfaceTension(body) if physics.surface_tension else None
    flow, valve = (Flow(body), Valve(body)) if physics.permeable else (None, None)
    return Matter(strains, walls, flow, valve, tension)


def touch_of(body: Body, below: Strain) -> Touch:
    """The terms of a scene's tip on the region below it."""
    law = body.scene.physics.contact
    if law.multiplier == "nodal":
        return Touch(NodalContact(body))
    normal = Traction(body, below)
    return Touch(
        normal,
        None if law.is_conservative else Friction(body, normal),
        Drag(body) if law.may_snap else None,
    )


def fields_of(scene: Scene) -> list[Field]:
    """The fields beside the displacement that all terms need."""
    return [
        *pressures(scene),
        *flow.fields(scene),
        *traction.fields(scene),
        *nodal.fields(scene),
        *friction.fields(scene),
    ]
