"""Limiting elastic laws of time-dependent materials: undrained, drained, unrelaxed, relaxed."""

from __future__ import annotations

from dataclasses import replace

from indent_sim.model.elastic_law import TwoConstantLaw
from indent_sim.model.gel import Gel
from indent_sim.model.hyperelasticity import NeoHookean
from indent_sim.model.linear_elasticity import TransverselyIsotropic
from indent_sim.model.materials import Material
from indent_sim.model.units import Scales
from indent_sim.theory.poroelasticity import PorousSolid


def undrained_law(material: Material) -> Material:
    """Return the elastic law of a material from which no pore fluid drains.

    At small strain its bulk modulus is K + alpha^2/storage. At finite strain its volume is
    constant, and the network of a gel is neo-Hookean.

    Parameters
    ----------
    material : Material
        A canonical material; a material without pore fluid is returned unchanged.

    Returns
    -------
    Material
        The undrained law, without pore fluid.
    """
    flow = material.flow
    if flow is None:
        return material
    E, nu = material.constants
    if isinstance(material, TransverselyIsotropic):
        return _undrained_anisotropic_law(material)
    if isinstance(material, Gel):
        return NeoHookean(E=3 * material.shear_modulus, nu=0.5)
    assert flow.permeability is not None
    solid = PorousSolid(E, nu, flow.permeability, flow.alpha, flow.storage)
    undrained_values = {"nu": solid.undrained_nu, "flow": None, "formulation": "auto"}
    if isinstance(material, TwoConstantLaw):
        undrained_values["E"] = solid.undrained_E
    return replace(material, **undrained_values)  # type: ignore[arg-type]


def _undrained_anisotropic_law(law: TransverselyIsotropic) -> Material:
    """Return the undrained law of a transversely isotropic material.

    The undrained compliance follows from the drained compliance S, the storage and the vector a = S
    alpha of strains per pore pressure:

        S_u = S - a a^T/(alpha^T S alpha + storage)

    (Woodbury identity). The vector a has the components `across` normal to the axis of symmetry,
    and `along` parallel to it.
    """
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


def relaxed_law(material: Material, fraction_remaining: float) -> Material:
    """Return the elastic law of a material after stress relaxation.

    Parameters
    ----------
    material : Material
        A canonical material; a material that does not relax is returned unchanged.
    fraction_remaining : float
        Remaining fraction of the instantaneous shear modulus. The bulk modulus has the same
        remaining fraction if the whole stress relaxes; otherwise it does not relax.

    Returns
    -------
    Material
        The relaxed law, without relaxation.
    """
    if material.relaxation is None:
        return material
    law = Scales(1.0, 1.0 / fraction_remaining).nondimensionalize(replace(material, flow=None))
    if material.has_shear_relaxation and material.constants.nu < 0.5:
        E, nu = material.relaxed_constants(fraction_remaining)
        relaxed_constants = {"nu": nu} | ({"E": E} if isinstance(law, TwoConstantLaw) else {})
        law = replace(law, **relaxed_constants)  # type: ignore[arg-type]
    return replace(law, relaxation=None, flow=material.flow)
