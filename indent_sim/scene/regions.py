"""Regions of the model domain: layers and inclusions with their materials and formulations."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from indent_sim.mesh.model_domain import ModelDomain, Region
from indent_sim.model.body import DimensionedBody
from indent_sim.model.gel import Gel
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.layers import Layer
from indent_sim.model.materials import Material
from indent_sim.model.measured_constants import LOCKING_POISSON_RATIO
from indent_sim.model.unbounded_bodies import UnboundedBody
from indent_sim.model.units import Scales, round_length
from indent_sim.process.errors import ConfigError
from indent_sim.scene.prescribed_history import remaining_modulus_fraction

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


D = TypeVar("D")
Layers = tuple[Layer, ...]


def elastic_layers(config: Config) -> Layers:
    """Return the layers with their instantaneous laws; the substrate has infinite thickness."""
    laws = [instantaneous_law(config, layer_material(layer)) for layer in config.layers]
    layers = zip(config.layers, laws, strict=True)
    return tuple(
        replace(layer, thickness=layer.thickness or inf, material=material)
        for layer, material in layers
    )


def instantaneous_law(config: Config, material: Material) -> Material:
    """Return the elastic law of a material with its instantaneous constants.

    Relaxation that all materials share is omitted, because it is applied to the elastic curve. A
    gel without a given stretch is in its state of free swelling in the first bath.
    """
    if isinstance(material, Gel):
        return material.with_free_swelling(config.initial_bath).canonical()
    return replace(
        material.canonical(),
        relaxation=material.relaxation if material.has_shear_relaxation else None,
    )


def layer_material(layer: Layer) -> Material:
    """Return the material of a layer, which is set in every resolved config."""
    assert layer.material is not None
    return layer.material


def layer_regions(config: Config, layers: Layers) -> tuple[Region, ...]:
    """Return the regions of the layers, bounded by the rounded heights of their lower faces."""
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
    """Yield the regions of the inclusions with rounded lengths."""
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
    """Return the smallest fraction of the instantaneous shear modulus during the history."""
    if not material.has_shear_relaxation:
        return 1.0
    return min(
        1.0, remaining_modulus_fraction(material.relaxation, config.loading.prescribed_history)
    )


def choose_formulation(key: str, material: Material, min_shear_fraction: float) -> str:
    """Choose the element formulation for the least compressible state of a material.

    Parameters
    ----------
    key : str
        The key of the material in the scene file.
    material : Material
        The material with its instantaneous constants.
    min_shear_fraction : float
        Smallest fraction of its instantaneous shear modulus during the history.

    Returns
    -------
    str
        "displacement", or "mixed" for displacement and pressure.

    Raises
    ------
    ConfigError
        If the requested formulation does not suit the material.
    """
    nu = material.relaxed_constants(min_shear_fraction).nu
    requested = material.formulation
    chosen = requested
    if requested == "auto":
        chosen = "mixed" if nu >= LOCKING_POISSON_RATIO else "displacement"
    law_text = (
        f"nu = {nu:g}"
        if material.is_isotropic
        else f"a compressibility like that of an isotropic material with nu = {nu:.6g}"
    )
    if min_shear_fraction < 1:
        law_text = f"{law_text} after relaxation of the shear modulus"
    # Larger Poisson's ratios make the matrix of displacement elements too ill-conditioned.
    max_displacement_nu = 0.49999
    if chosen == "displacement" and nu > max_displacement_nu:
        raise ConfigError(
            f"{key}.formulation",
            f"displacement elements are not possible with {law_text}",
            "use 'mixed'",
        )
    if chosen == "mixed" and nu <= 0:
        raise ConfigError(
            f"{key}.formulation",
            f"'mixed' needs nu > 0, and this material has {law_text}",
            "use 'displacement'",
        )
    return chosen


def round_lengths(body: D) -> D:
    """Return a body or an inclusion with rounded lengths, so that equal lengths compare equal."""

    def rounded(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(rounded, value))
        return round_length(value) if isinstance(value, float) else value

    fields = dataclasses.fields(body)  # type: ignore[arg-type]
    rounded_values = {field.name: rounded(getattr(body, field.name)) for field in fields}
    return replace(body, **rounded_values)  # type: ignore[type-var]


def unused_material_message(config: Config, domain: ModelDomain) -> str:
    """Return a message if no region of the body uses the section `material`, otherwise ""."""
    if config.material is None:
        return ""
    if isinstance(config.body, MeshFromFile):
        region_kind = "region"
        is_used = any(region.name == "body" for region in domain.regions)
    else:
        region_kind = "layer"
        is_used = any(config.material_key(k) == "material" for k in range(len(config.layers)))
    if is_used:
        return ""
    return f"the section `material` is not used: every {region_kind} has its own material"


def remove_unused_material(config: Config, domain: ModelDomain) -> Config:
    """Return the config without the section `material` if no region of the body uses it."""
    return (
        config.model_copy(update={"material": None})
        if unused_material_message(config, domain)
        else config
    )
