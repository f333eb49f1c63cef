"""Variants of a scene: its config with simpler or richer models of material, body or tip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from itertools import accumulate
from math import inf
from typing import Any

from indent_sim.config.scene_file import to_mapping
from indent_sim.config.scene_sections import SolverSettings, Source
from indent_sim.config.schema import Config
from indent_sim.model.gel import Gel
from indent_sim.model.hyperelasticity import NeoHookean
from indent_sim.model.inclusions import Inclusion
from indent_sim.model.layers import Layer
from indent_sim.model.linear_elasticity import LinearElastic, TransverselyIsotropic
from indent_sim.model.materials import Material
from indent_sim.model.spherical_bodies import Ball, Cap
from indent_sim.model.unbounded_bodies import HalfSpace, InfiniteLayer
from indent_sim.scene import limiting_elastic_laws

# A scene as nested mappings, as in its file.
Document = dict[str, Any]
LawChange = Callable[[Material], Material]


def replace_sections(config: Config, **changes: Any) -> Config:
    """Return the config with some sections replaced.

    Parameters
    ----------
    config
        The scene.
    **changes
        New sections by name.

    Raises
    ------
    ConfigError
        If the new scene is invalid; it is checked like a scene from a file.
    """
    variant = Config(**{name: getattr(config, name) for name in Config.model_fields} | changes)
    variant._source = Source(config.source.name)
    return variant


def change_materials(config: Config, change: LawChange, **sections: Any) -> Config:
    """Return the config with all of its materials changed.

    Parameters
    ----------
    config
        The scene.
    change
        Function that is applied to the materials of the section `material`, the layers, inclusions
        and regions.
    **sections
        Other sections to replace, by name.
    """

    def change_item(item: Layer | Inclusion) -> Layer | Inclusion:
        """Return a layer or an inclusion; its own material, if it has one, is changed."""
        return replace(item, material=change(item.material)) if item.material else item

    item_lists = {name: getattr(config.body, name) for name in ("layers", "inclusions")}
    body_changes: Document = {
        name: tuple(map(change_item, items)) for name, items in item_lists.items() if items
    }
    if regions := getattr(config.body, "regions", None):
        body_changes["regions"] = {name: change(material) for name, material in regions.items()}
    body = replace(config.body, **body_changes)
    material = config.material and change(config.material)
    return replace_sections(config, body=body, material=material, **sections)


def set_gel_stretch(config: Config) -> Config:
    """Return the config with the initial stretch of every gel as a number.

    If the config does not give a stretch, the gel is assumed to swell freely in the first bath.
    """
    bath = config.initial_bath
    return change_materials(
        config, lambda law: law.with_free_swelling(bath) if isinstance(law, Gel) else law
    )


def instantaneous_law(material: Material) -> Material:
    """Return the material without relaxation, with its instantaneous constants."""
    return replace(material, relaxation=None)


def drained_law(material: Material) -> Material:
    """Return the drained elastic law of a poroelastic material."""
    return replace(material, flow=None)


def undrained_law(material: Material) -> Material:
    """Return the undrained elastic law of a poroelastic material; other materials are unchanged."""
    return limiting_elastic_laws.undrained_law(material.canonical()) if material.flow else material


def rounded_law(material: Material) -> Material:
    """Return the material with its numbers rounded to twelve digits."""
    numbers = {field.name: getattr(material, field.name) for field in fields(material)}
    rounded = {name: float(f"{x:.12g}") for name, x in numbers.items() if isinstance(x, float)}
    return replace(material, **rounded)  # type: ignore[arg-type]


def change_laws(config: Config, change: LawChange, **sections: Any) -> Config:
    """Return the config with the laws of body and soft tip changed, such as to finite strain.

    The parameters are those of `change_materials`.
    """
    tip: Any = config.indenter
    if tip.elastic_part:
        sections["indenter"] = replace(tip, material=change(tip.material))
    return change_materials(config, change, **sections)


def linear_law(material: Material) -> Material:
    """Return the linear elastic material with the same E and nu; anisotropic laws are unchanged."""
    law = material.canonical()
    if law.is_small_strain and not law.is_isotropic:
        return law
    return LinearElastic(**_rounded_constants(law))


def hyperelastic_law(material: Material) -> Material:
    """Return the finite-strain law of a material, by default neo-Hookean."""
    law = material.canonical()
    return NeoHookean(**_rounded_constants(law)) if law.is_small_strain else material


def elastic_law(material: Material) -> Material:
    """Return the material without plasticity; other materials are unchanged."""
    if material.plasticity is None:
        return material
    return replace(material, plasticity=None)  # type: ignore[arg-type]


def isotropic_law(material: Material) -> Material:
    """Return the isotropic material with E and nu of the plane of isotropy."""
    law = material.canonical()
    return LinearElastic(E=law.E, nu=law.nu) if isinstance(law, TransverselyIsotropic) else material


def incompressible_law(material: Material, nu_deficit: float = 0.0) -> Material:
    """Return the linear elastic material with the same E and nu = 0.5 - nu_deficit."""
    return LinearElastic(E=material.canonical().constants.E, nu=0.5 - nu_deficit)


def _rounded_constants(law: Material) -> dict[str, Any]:
    """Return Young's modulus and Poisson's ratio, rounded to twelve digits.

    The rounding removes the rounding errors of their conversion.
    """
    return {
        name: float(f"{value:.12g}") for name, value in zip(("E", "nu"), law.constants, strict=True)
    }


def remove_inclusions(config: Config) -> Config:
    """Return the scene without its inclusions."""
    if not config.body.inclusions:
        return config
    mesh = replace(config.mesh, h_inclusions=None)
    return replace_sections(config, body=replace(config.body, inclusions=None), mesh=mesh)


def remove_inclusion_contrast(config: Config) -> Config:
    """Return the scene with inclusions of the surrounding material, on the same mesh."""
    body: Any = config.body
    interface_depths = list(accumulate(layer.thickness or inf for layer in config.layers))

    def replace_material(inclusion: Inclusion) -> Inclusion:
        """Return the inclusion with the material of the layer that contains its center."""
        depth = (
            body.spherical_body.wall_clearance(inclusion)
            if isinstance(body, Cap | Ball)
            else -inclusion.center[2]
        )
        layer = next((k for k, bottom in enumerate(interface_depths) if depth < bottom), -1)
        return replace(inclusion, material=config.layers[layer].material)  # type: ignore[arg-type]

    return replace_sections(
        config, body=replace(body, inclusions=tuple(map(replace_material, body.inclusions)))
    )


def half_space_variant(config: Config) -> Config:
    """Return the scene on a half-space, whose last layer is infinitely thick."""
    layers = config.body.layers
    tension = config.body.surface_tension
    half_space_layers = layers and (*layers[:-1], replace(layers[-1], thickness=None))
    return replace_sections(
        remove_inclusions(config),
        body=HalfSpace(layers=half_space_layers, surface_tension=tension),
        center=None,
    )


def layer_variant(config: Config) -> Config:
    """Return the scene on an infinitely wide layer: its body without side walls."""
    body: Any = config.body
    layer = InfiniteLayer(
        body.height, base=body.base, layers=body.layers, surface_tension=body.surface_tension
    )
    return replace_sections(remove_inclusions(config), body=layer, center=None)


def finite_strain_variant(config: Config) -> Config:
    """Return the scene with materials and gap of finite strain.

    The variant has default solver settings, and no experiment, because an experiment needs an
    elastic load curve.
    """
    return _reset_gap(
        change_laws(config, hyperelastic_law, solver=SolverSettings(), experiment=None)
    )


def small_strain_variant(config: Config) -> Config:
    """Return the scene with materials and gap of small strain."""
    return _reset_gap(change_laws(config, linear_law))


def _reset_gap(config: Config) -> Config:
    """Return the scene with the default gap of its materials."""
    has_gap = any(field.name == "gap" for field in fields(config.contact))
    if not has_gap:
        return config
    return replace_sections(config, contact=replace(config.contact, gap="auto"))


def minimal_document(config: Config) -> Document:
    """Return the document of the scene, without sections that have only default values."""
    defaults = {name: section.default for name, section in Config.model_fields.items()}
    return {
        name: section
        for name, section in to_mapping(config).items()
        if section != {} and getattr(config, name) != defaults[name]
    }
