"""Elastic limits of time-dependent materials: undrained and drained, unrelaxed and relaxed."""

from __future__ import annotations

from dataclasses import replace

from indent_sim.model.gel import Gel
from indent_sim.model.hyperelasticity import NeoHookean
from indent_sim.model.linear_elasticity import LinearElastic, TransverselyIsotropic
from indent_sim.model.materials import Material
from indent_sim.model.units import Scales
from indent_sim.theory.poroelasticity import PorousSolid


def undrained_law(material: Material) -> Material:
    """The elastic law of a canonical material from which no fluid leaves; the material itself where
    none flows.

    At small strain its bulk modulus is K + alpha^2/storage, at finite strain its volume stays what
    it is; a gel's network is neo-Hookean then.
    """
    flow = material.flow
    law = material
    if flow is None:
        return material
    E, nu = law.constants
    if isinstance(law, TransverselyIsotropic):
        return _undrained_anisotropic_law(law)
    if isinstance(law, Gel):
        return NeoHookean(E=3 * law.shear_modulus, nu=0.5)
    assert flow.permeability is not None
    solid = PorousSolid(E, nu, flow.permeability, flow.alpha, flow.storage)
    undrained_values = {"nu": solid.undrained_nu, "flow": None, "formulation": "auto"}
    undrained_values |= (
        {"E": solid.undrained_E} if isinstance(law, LinearElastic | NeoHookean) else {}
    )
    return replace(law, **undrained_values)  # type: ignore[arg-type]


def _undrained_anisotropic_law(law: TransverselyIsotropic) -> Material:
    """S_u = S - (S alpha)(S alpha)^T/(alpha S alpha + storage) of the compliance S (Woodbury)."""
    assert law.flow is not None
    E = law.E
    E_z = law.E_z
    nu = law.nu
    nu_z = law.nu_z
    alpha = law.flow.alpha
    across = alpha * ((1 - nu) / E - nu_z / E_z)
    along = alpha * (1 - 2 * nu_z) / E_z
    storage_compliance = alpha * (2 * across + along) + law.flow.storage
    E_u = 1 / (1 / E - across**2 / storage_compliance)
    E_zu = 1 / (1 / E_z - along**2 / storage_compliance)
    nu_zu = (nu_z / E_z + across * along / storage_compliance) * E_zu if law.flow.storage else 0.5
    nu_u = (
        (nu / E + across**2 / storage_compliance) * E_u
        if law.flow.storage
        else 1 - E_u / (2 * E_zu)
    )
    return replace(law, E=E_u, E_z=E_zu, nu=nu_u, nu_z=nu_zu, flow=None, formulation="auto")


def relaxed_law(material: Material, left: float) -> Material:
    """The elastic law of a canonical material of which a share of the shear stress is left, and all
    of the bulk modulus, or where everything relaxes the same share of it; the material itself
    where nothing does.
    """
    if material.relaxation is None:
        return material
    law = Scales(1.0, 1.0 / left).nondimensionalize(replace(material, flow=None))
    if material.has_shear_relaxation and material.constants.nu < 0.5:
        E, nu = material.relaxed_constants(left)
        relaxed_constants = {"nu": nu} | ({"E": E} if isinstance(law, LinearElastic) else {})
        law = replace(law, **relaxed_constants)  # type: ignore[arg-type]
    return replace(law, relaxation=None, flow=material.flow)
