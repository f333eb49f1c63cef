"""Bulk terms and contact terms of a scene, and the unknown fields that they need."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.terms import flow
from indent_sim.fe.terms.contact import active_set, friction, traction
from indent_sim.fe.terms.contact.active_set import NodalContact
from indent_sim.fe.terms.contact.friction import Friction
from indent_sim.fe.terms.contact.soft_tip_contact import SoftTipContact
from indent_sim.fe.terms.contact.traction import Traction
from indent_sim.fe.terms.contact.viscous_regularization import ViscousRegularization
from indent_sim.fe.terms.contact_seal import ContactSeal
from indent_sim.fe.terms.flow import Flow
from indent_sim.fe.terms.plasticity import PlasticStrainEnergy
from indent_sim.fe.terms.strain_energy import StrainEnergy, pressure_fields
from indent_sim.fe.terms.surface_tension import SurfaceTension
from indent_sim.fe.terms.term import Term
from indent_sim.fe.terms.viscoelasticity import ViscoelasticStrainEnergy
from indent_sim.fe.terms.weak_roller import WeakRollerBC
from indent_sim.fe.unknowns import Field
from indent_sim.mesh.model_domain import Region
from indent_sim.scene.scene import Scene


@dataclass(frozen=True)
class BulkTerms:
    """Terms of the body without its contact.

    Attributes
    ----------
    strain_energies : tuple of StrainEnergy
        One term for each region; the region under the tip is first.
    rollers : tuple of WeakRollerBC
        Roller condition of a curved wall.
    flow : Flow, optional
        Fluid in the pores.
    seal : ContactSeal, optional
        Boundary conditions of the fluid.
    surface_tension : SurfaceTension, optional
        Tension of the contact surface.
    """

    strain_energies: tuple[StrainEnergy, ...]
    rollers: tuple[WeakRollerBC, ...]
    flow: Flow | None = None
    seal: ContactSeal | None = None
    surface_tension: SurfaceTension | None = None

    def __iter__(self) -> Iterator[Term]:
        yield from (
            term
            for term in (
                *self.strain_energies,
                *self.rollers,
                self.flow,
                self.seal,
                self.surface_tension,
            )
            if term
        )


@dataclass(frozen=True)
class ContactTerms:
    """Terms of the contact with the tip.

    Attributes
    ----------
    pressure : Traction, NodalContact or SoftTipContact
        Contact pressure by the scene's contact method, or contact pressure between two meshed
        bodies.
    friction : Friction, optional
        Tangential traction.
    regularization : ViscousRegularization, optional
        Drag on the surface while it snaps to or from an adhesive tip.
    """

    pressure: Traction | NodalContact | SoftTipContact
    friction: Friction | None = None
    regularization: ViscousRegularization | None = None

    def __iter__(self) -> Iterator[Term]:
        yield from (term for term in (self.pressure, self.friction, self.regularization) if term)


def bulk_terms(body: Body) -> BulkTerms:
    """Create the terms of the scene's body."""
    physics = body.scene.physics
    strain_energies = tuple(
        _strain_energy_class(region)(body, region) for region in physics.domain.regions
    )
    rollers = (WeakRollerBC(body),) if physics.wall_stiffness else ()
    surface_tension = SurfaceTension(body) if physics.surface_tension else None
    pore_flow, seal = (Flow(body), ContactSeal(body)) if physics.permeable_regions else (None, None)
    return BulkTerms(strain_energies, rollers, pore_flow, seal, surface_tension)


def _strain_energy_class(region: Region) -> type[StrainEnergy]:
    """Return the term for the material of a region."""
    if region.relaxation_series:
        return ViscoelasticStrainEnergy
    return PlasticStrainEnergy if region.material.plasticity else StrainEnergy


def contact_terms(body: Body, strain_energy: StrainEnergy) -> ContactTerms:
    """Create the terms of the scene's contact.

    Parameters
    ----------
    body : Body
        Discrete body.
    strain_energy : StrainEnergy
        Term of the region under the tip, whose stress Nitsche's method uses.
    """
    law = body.scene.physics.contact
    if body.scene.physics.has_two_bodies:
        return ContactTerms(SoftTipContact(body))
    if law.multiplier == "nodal":
        return ContactTerms(NodalContact(body))
    pressure = Traction(body, strain_energy)
    return ContactTerms(
        pressure,
        None if law.is_conservative else Friction(body, pressure),
        ViscousRegularization(body) if law.may_snap_through else None,
    )


def additional_fields(scene: Scene) -> list[Field]:
    """Return the unknown fields that the terms need in addition to the displacement."""
    return [
        *pressure_fields(scene),
        *flow.fields(scene),
        *traction.fields(scene),
        *active_set.fields(scene),
        *friction.fields(scene),
    ]
