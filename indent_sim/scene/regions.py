"""Regions of the model domain: layers and inclusions with their materials and formulations."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from indent_sim.mesh.model_domain import ModelDomain, Region
from indent_sim.model.body import (
    DimensionedBody,
    Layer,
    MeshFromFile,
    UnboundedBody,
)
from indent_sim.model.materials import LOCKING_POISSON_RATIO, Gel, Material
from indent_sim.model.units import Scales, round_length
from indent_sim.process.errors import ConfigError
from indent_sim.scene.prescribed_history import remaining_modulus_fraction

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


D = TypeVar("D")
Layers = tuple[Layer, ...]
MAX_DISPLACEMENT_NU = (
    0.49999  # Poisson's ratio beyond which a displacement element's matrix loses its digits
)


def elastic_layers(config: Config) -> Layers:
    """The layers from the top, each with its thickness (a half-space's last: infinite) and its
    material's constants.
    """
    laws = [instantaneous_law(config, layer_material(layer)) for layer in config.layers]
    layers = zip(config.layers, laws, strict=True)
    return tuple(
        replace(layer, thickness=layer.thickness or inf, material=material)
        for layer, material in layers
    )


def instantaneous_law(config: Config, material: Material) -> Material:
    """The law of the instantaneous constants: what relaxes as a whole is made of its elastic curve.
    A gel has swollen in the scene's first bath where it does not say by how much.
    """
    if isinstance(material, Gel):
        return material.with_free_swelling(config.initial_bath).canonical()
    return replace(
        material.canonical(),
        relaxation=material.relaxation if material.has_shear_relaxation else None,
    )


def layer_material(layer: Layer) -> Material:
    assert layer.material is not None
    return layer.material


def layer_regions(config: Config, layers: Layers) -> tuple[Region, ...]:
    """The regions of layers, z of their lower faces rounded as all lengths of a mesh."""
    regions = []
    depths = np.cumsum([layer.thickness for layer in layers])
    for k, (layer, depth) in enumerate(zip(layers, depths, strict=True)):
        name = f"layers[{k}]" if len(layers) > 1 else "body"
        material = layer_material(layer)
        shear_fraction = least_shear_fraction(config, material)
        formulation = choose_formulation(config.material_key(k), material, shear_fraction)
        regions.append(
            Region(
                name,
                material,
                formulation,
                -round_length(float(depth)),
                min_shear_fraction=shear_fraction,
            )
        )
    return tuple(regions)


def inclusion_regions(
    config: Config, body: DimensionedBody | UnboundedBody, scales: Scales
) -> Iterator[Region]:
    """The regions of inclusions, lengths rounded likewise."""
    laws = [
        instantaneous_law(config, inclusion.material) for inclusion in config.body.inclusions or ()
    ]
    for k, (inclusion, material) in enumerate(zip(body.inclusions or (), laws, strict=True)):
        law = scales.nondimensionalize(material)
        name = f"inclusions[{k}]"
        shear_fraction = least_shear_fraction(config, material)
        formulation = choose_formulation(f"body.{name}.material", law, shear_fraction)
        yield Region(
            name,
            law,
            formulation,
            inclusion=round_lengths(inclusion),
            min_shear_fraction=shear_fraction,
        )


def least_shear_fraction(config: Config, material: Material) -> float:
    """What is left of a material's shear modulus when it has relaxed most on the way of a scene, at
    most 1.
    """
    if not material.has_shear_relaxation:
        return 1.0
    return min(
        1.0, remaining_modulus_fraction(material.relaxation, config.loading.prescribed_history)
    )


def choose_formulation(key: str, material: Material, least_share: float) -> str:
    """Displacements alone, or with a pressure, for the most incompressible state of a material on
    its way.

    Parameters
    ----------
    key : str
        Where the material stands in the scene file.
    material : Material
        Its law at the first moment.
    least_share : float
        What is left of its shear modulus when it has relaxed most.

    Returns
    -------
    str
        displacement | mixed.

    Raises
    ------
    ConfigError
        Where the material or the elements that it asks for cannot.
    """
    nu = material.relaxed_constants(least_share).nu
    requested = material.formulation
    chosen = (
        requested
        if requested != "auto"
        else "mixed"
        if nu >= LOCKING_POISSON_RATIO
        else "displacement"
    )
    law_text = (
        f"nu = {nu:g}" if material.is_isotropic else f"matter as compressible as nu = {nu:.6g}"
    )
    if least_share < 1:
        law_text = f"shear that relaxes to {law_text}"
    if chosen == "displacement" and nu > MAX_DISPLACEMENT_NU:
        raise ConfigError(
            f"{key}.formulation", f"displacement elements cannot carry {law_text}", "use 'mixed'"
        )
    if chosen == "mixed" and nu <= 0:
        raise ConfigError(
            f"{key}.formulation",
            f"'mixed' needs nu > 0, and this is {law_text}",
            "use 'displacement'",
        )
    return chosen


def round_lengths(body: D) -> D:
    """A body, or an inclusion, with its own lengths rounded."""

    def to_digits(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(to_digits, value))
        return round_length(value) if isinstance(value, float) else value

    fields = dataclasses.fields(body)  # type: ignore[arg-type]
    return replace(body, **{f.name: to_digits(getattr(body, f.name)) for f in fields})  # type: ignore[type-var]


def unused_material_message(config: Config, domain: ModelDomain) -> str:
    """That nothing of a body has the material of the section `material`, in words; empty where
    something has.
    """
    if config.material is None:
        return ""
    if isinstance(config.body, MeshFromFile):
        region_kind = "region"
        is_used = any(region.name == "body" for region in domain.regions)
    else:
        region_kind = "layer"
        is_used = any(config.material_key(k) == "material" for k in range(len(config.layers)))
    return "" if is_used else f"nothing uses `material`: every {region_kind} has its own"


def remove_unused_material(config: Config, domain: ModelDomain) -> Config:
    """The config without the section `material` where nothing of the body has it."""
    return (
        config.model_copy(update={"material": None})
        if unused_material_message(config, domain)
        else config
    )
