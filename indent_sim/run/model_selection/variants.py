"""Variations of a scene: its config with a simpler or a richer model in place of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from itertools import accumulate
from math import inf
from typing import Any

from indent_sim.config.scene_file import config_from_mapping, to_mapping
from indent_sim.config.schema import Config, SolverSettings, Source
from indent_sim.model.gel import Gel
from indent_sim.model.hyperelasticity import NeoHookean
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.inclusions import Inclusion
from indent_sim.model.layers import Layer
from indent_sim.model.linear_elasticity import LinearElastic, TransverselyIsotropic
from indent_sim.model.materials import Material
from indent_sim.model.spherical_bodies import Ball, Cap
from indent_sim.model.unbounded_bodies import HalfSpace, InfiniteLayer
from indent_sim.scene import elastic_limit_laws

Document = dict[str, Any]  # a scene as nested mappings, shaped like its file
LawChange = Callable[[Material], Material]

DEFAULT_SECTIONS = (
    "units",
    "contact",
    "mesh",
    "solver",
    "output",
)  # sections left out of a scene where all is as usual
MINIMAL_SCENE: Document = {
    "body": {"shape": "half_space"},
    "indenter": {"shape": "sphere", "R": 1.0},
}
MINIMAL_SCENE |= {
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.0},
    "loading": {"delta": 0.1},
}


def replace_sections(config: Config, **changes: Any) -> Config:
    """The config with some sections replaced, checked as that of a file; ConfigError for one that
    cannot exist.
    """
    variant = Config(**{name: getattr(config, name) for name in Config.model_fields} | changes)
    variant._source = Source(config.source.name)
    return variant


def materials(config: Config) -> list[Material]:
    """All materials of a scene, those of the layers first."""
    laws = (
        [layer.material for layer in config.layers]
        if not isinstance(config.body, MeshFromFile)
        else []
    )
    laws += [inclusion.material for inclusion in config.body.inclusions or ()]
    laws += (
        [config.material, *regions.values()]
        if (regions := getattr(config.body, "regions", None))
        else []
    )
    return [material.canonical() for material in laws or [config.material] if material]


def change_materials(config: Config, change: LawChange, **sections: Any) -> Config:
    """The config with each of its materials changed: that of the section, of layers, inclusions and
    regions; and with other sections replaced.
    """

    def changed(part: Layer | Inclusion) -> Layer | Inclusion:
        return replace(part, material=change(part.material)) if part.material else part

    item_lists = {name: getattr(config.body, name) for name in ("layers", "inclusions")}
    parts: Document = {
        name: tuple(map(changed, items)) for name, items in item_lists.items() if items
    }
    if regions := getattr(config.body, "regions", None):
        parts["regions"] = {name: change(material) for name, material in regions.items()}
    body = replace(config.body, **parts)
    material = config.material and change(config.material)
    return replace_sections(config, body=body, material=material, **sections)


def set_gel_stretch(config: Config) -> Config:
    """The config with the stretch of its gels as a number: that in the first bath, where it is
    auto.
    """
    bath = config.initial_bath
    return change_materials(
        config, lambda law: law.with_free_swelling(bath) if isinstance(law, Gel) else law
    )


def instantaneous_law(material: Material) -> Material:
    """The material of the instantaneous constants, which does not relax."""
    return replace(material, relaxation=None)


def drained_law(material: Material) -> Material:
    """The material in whose pores nothing flows any more."""
    return replace(material, flow=None)


def undrained_law(material: Material) -> Material:
    """The elastic material from whose pores nothing flows yet; any other as it is."""
    return elastic_limit_laws.undrained_law(material.canonical()) if material.flow else material


def rounded_law(material: Material) -> Material:
    """A material whose numbers came of others, which have no more than twelve digits."""
    numbers = {field.name: getattr(material, field.name) for field in fields(material)}
    rounded = {name: float(f"{x:.12g}") for name, x in numbers.items() if isinstance(x, float)}
    return replace(material, **rounded)  # type: ignore[arg-type]


def linear_law(material: Material) -> Material:
    """The linear elastic material of equal constants; an anisotropic one is that already."""
    law = material.canonical()
    return (
        law
        if law.is_small_strain and not law.is_isotropic
        else LinearElastic(**_rounded_constants(law))
    )


def hyperelastic_law(material: Material) -> Material:
    """The finite-strain law of a material: its own, or neo-Hookean with the same constants."""
    law = material.canonical()
    return NeoHookean(**_rounded_constants(law)) if law.is_small_strain else material


def isotropic_law(material: Material) -> Material:
    """The linear elastic material with the E and nu of a transversely isotropic one, those across
    its axis.
    """
    law = material.canonical()
    return LinearElastic(E=law.E, nu=law.nu) if isinstance(law, TransverselyIsotropic) else material


def incompressible_law(material: Material, less: float = 0.0) -> Material:
    """A linear elastic material with nu = 0.5, or less, in place of its own."""
    return LinearElastic(E=material.canonical().constants.E, nu=0.5 - less)


def _rounded_constants(law: Material) -> dict[str, Any]:
    """E and nu to twelve digits, as what came of other constants has no more."""
    return {
        name: float(f"{value:.12g}") for name, value in zip(("E", "nu"), law.constants, strict=True)
    }


def remove_inclusions(config: Config) -> Config:
    """The scene without its inclusions."""
    if not config.body.inclusions:
        return config
    mesh = replace(config.mesh, h_inclusions=None)
    return replace_sections(config, body=replace(config.body, inclusions=None), mesh=mesh)


def remove_inclusion_contrast(config: Config) -> Config:
    """The scene with its inclusions of the matter that is around them: on the mesh of the scene
    that has them.
    """
    body: Any = config.body
    depths = list(accumulate(layer.thickness or inf for layer in config.layers))

    def around(inclusion: Inclusion) -> Inclusion:
        below = (
            body.spherical_body.wall_clearance(inclusion)
            if isinstance(body, Cap | Ball)
            else -inclusion.center[2]
        )
        layer = next((k for k, depth in enumerate(depths) if below < depth), -1)
        return replace(inclusion, material=config.layers[layer].material)  # type: ignore[arg-type]

    return replace_sections(
        config, body=replace(body, inclusions=tuple(map(around, body.inclusions)))
    )


def half_space_variant(config: Config) -> Config:
    """The scene on the half-space of its body's matter: the last of its layers goes on without end."""
    layers = config.body.layers
    tension = config.body.surface_tension
    deep = layers and (*layers[:-1], replace(layers[-1], thickness=None))
    return replace_sections(
        remove_inclusions(config),
        body=HalfSpace(layers=deep, surface_tension=tension),
        center=None,
    )


def layer_variant(config: Config) -> Config:
    """The scene on the infinitely wide layer that its body is without its sides."""
    body: Any = config.body
    layer = InfiniteLayer(
        body.height, base=body.base, layers=body.layers, surface_tension=body.surface_tension
    )
    return replace_sections(remove_inclusions(config), body=layer, center=None)


def finite_strain_variant(config: Config) -> Config:
    """A scene whose materials and gap are of finite strain: solved whole, and no curve determines
    its experiment.
    """
    return _reset_gap(
        change_materials(config, hyperelastic_law, solver=SolverSettings(), experiment=None)
    )


def small_strain_variant(config: Config) -> Config:
    """A scene whose materials and gap are of small strain."""
    return _reset_gap(change_materials(config, linear_law))


def _reset_gap(config: Config) -> Config:
    has_gap = any(field.name == "gap" for field in fields(config.contact))
    return (
        replace_sections(config, contact=replace(config.contact, gap="auto")) if has_gap else config
    )


def minimal_document(config: Config) -> Document:
    """A scene as its file has it, without the sections in which all is as usual."""
    defaults = to_mapping(config_from_mapping(MINIMAL_SCENE))
    document = {
        name: section for name, section in to_mapping(config).items() if section not in ({}, "")
    }
    return {
        name: section
        for name, section in document.items()
        if not (name in DEFAULT_SECTIONS and section == defaults.get(name))
    }
