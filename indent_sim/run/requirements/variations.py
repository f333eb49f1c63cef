"""Variations of a scene: its config with a simpler or a richer model in place of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from itertools import accumulate
from math import inf
from typing import Any

from indent_sim.config.scene_file import from_mapping, to_mapping
from indent_sim.config.schema import Config, SolverSettings, Source
from indent_sim.model.body import (
    Ball,
    Cap,
    HalfSpace,
    Inclusion,
    InfiniteLayer,
    Layer,
    MeshFromFile,
)
from indent_sim.model.materials import (
    Gel,
    LinearElastic,
    Material,
    NeoHookean,
    TransverselyIsotropic,
)
from indent_sim.scene import reference_theory

Document = dict[str, Any]  # a scene as nested mappings, shaped like its file
Change = Callable[[Material], Material]

DEFAULTED = (
    "units",
    "contact",
    "mesh",
    "solver",
    "output",
)  # sections left out of a scene where all is as usual
ANY_SCENE: Document = {"body": {"shape": "half_space"}, "indenter": {"shape": "sphere", "R": 1.0}}
ANY_SCENE |= {
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.0},
    "loading": {"delta": 0.1},
}


def varied(config: Config, **changes: Any) -> Config:
    """The config with some sections replaced, checked as that of a file; ConfigError for one that
    cannot exist.
    """
    found = Config(**{name: getattr(config, name) for name in Config.model_fields} | changes)
    found._source = Source(config.source.name)
    return found


def matter(config: Config) -> list[Material]:
    """All materials of a scene, those of the layers first."""
    found = (
        [layer.material for layer in config.layers]
        if not isinstance(config.body, MeshFromFile)
        else []
    )
    found += [inclusion.material for inclusion in config.body.inclusions or ()]
    found += (
        [config.material, *regions.values()]
        if (regions := getattr(config.body, "regions", None))
        else []
    )
    return [material.canonical() for material in found or [config.material] if material]


def with_matter(config: Config, change: Change, **sections: Any) -> Config:
    """The config with each of its materials changed: that of the section, of layers, inclusions and
    regions; and with other sections replaced.
    """

    def changed(part: Layer | Inclusion) -> Layer | Inclusion:
        return replace(part, material=change(part.material)) if part.material else part

    several = {name: getattr(config.body, name) for name in ("layers", "inclusions")}
    parts: Document = {name: tuple(map(changed, found)) for name, found in several.items() if found}
    if regions := getattr(config.body, "regions", None):
        parts["regions"] = {name: change(material) for name, material in regions.items()}
    body = replace(config.body, **parts)
    material = config.material and change(config.material)
    return varied(config, body=body, material=material, **sections)


def with_swollen_gels(config: Config) -> Config:
    """The config with the stretch of its gels as a number: that in the first bath, where it is
    auto.
    """
    bath = config.first_bath
    return with_matter(config, lambda law: law.swollen_in(bath) if isinstance(law, Gel) else law)


def elastic(material: Material) -> Material:
    """The material of the instantaneous constants, which does not relax."""
    return replace(material, relaxation=None)


def drained(material: Material) -> Material:
    """The material in whose pores nothing flows any more."""
    return replace(material, flow=None)


def undrained(material: Material) -> Material:
    """The elastic material from whose pores nothing flows yet; any other as it is."""
    return reference_theory.undrained_law(material.canonical()) if material.flow else material


def rounded_law(material: Material) -> Material:
    """A material whose numbers came of others, which have no more than twelve digits."""
    numbers = {one.name: getattr(material, one.name) for one in fields(material)}
    short = {name: float(f"{x:.12g}") for name, x in numbers.items() if isinstance(x, float)}
    return replace(material, **short)  # type: ignore[arg-type]


def linear(material: Material) -> Material:
    """The linear elastic material of equal constants; an anisotropic one is that already."""
    own = material.canonical()
    return own if own.small_strain and not own.is_isotropic else LinearElastic(**_constants(own))


def hyperelastic(material: Material) -> Material:
    """The finite-strain law of a material: its own, or neo-Hookean with the same constants."""
    own = material.canonical()
    return NeoHookean(**_constants(own)) if own.small_strain else material


def isotropic(material: Material) -> Material:
    """The linear elastic material with the E and nu of a transversely isotropic one, those across
    its axis.
    """
    own = material.canonical()
    return LinearElastic(E=own.E, nu=own.nu) if isinstance(own, TransverselyIsotropic) else material


def incompressible(material: Material, less: float = 0.0) -> Material:
    """A linear elastic material with nu = 0.5, or less, in place of its own."""
    return LinearElastic(E=material.canonical().constants.E, nu=0.5 - less)


def _constants(own: Material) -> dict[str, Any]:
    """E and nu to twelve digits, as what came of other constants has no more."""
    return {
        name: float(f"{value:.12g}") for name, value in zip(("E", "nu"), own.constants, strict=True)
    }


def without_inclusions(config: Config) -> Config:
    """The scene without its inclusions."""
    if not config.body.inclusions:
        return config
    mesh = replace(config.mesh, h_inclusions=None)
    return varied(config, body=replace(config.body, inclusions=None), mesh=mesh)


def without_contrast(config: Config) -> Config:
    """The scene with its inclusions of the matter that is around them: on the mesh of the scene
    that has them.
    """
    body: Any = config.body
    depths = list(accumulate(layer.thickness or inf for layer in config.layers))

    def around(inclusion: Inclusion) -> Inclusion:
        below = (
            body.dome.room_beside(inclusion)
            if isinstance(body, Cap | Ball)
            else -inclusion.center[2]
        )
        layer = next((k for k, depth in enumerate(depths) if below < depth), -1)
        return replace(inclusion, material=config.layers[layer].material)  # type: ignore[arg-type]

    return varied(config, body=replace(body, inclusions=tuple(map(around, body.inclusions))))


def on_half_space(config: Config) -> Config:
    """The scene on the half-space of its body's matter: the last of its layers goes on without end."""
    layers = config.body.layers
    tension = config.body.surface_tension
    deep = layers and (*layers[:-1], replace(layers[-1], thickness=None))
    return varied(
        without_inclusions(config),
        body=HalfSpace(layers=deep, surface_tension=tension),
        center=None,
    )


def on_layer(config: Config) -> Config:
    """The scene on the infinitely wide layer that its body is without its sides."""
    body: Any = config.body
    layer = InfiniteLayer(
        body.height, base=body.base, layers=body.layers, surface_tension=body.surface_tension
    )
    return varied(without_inclusions(config), body=layer, center=None)


def of_finite_strain(config: Config) -> Config:
    """A scene whose materials and gap are of finite strain: solved whole, and no curve determines
    its experiment.
    """
    return _of_any_gap(with_matter(config, hyperelastic, solver=SolverSettings(), experiment=None))


def of_small_strain(config: Config) -> Config:
    """A scene whose materials and gap are of small strain."""
    return _of_any_gap(with_matter(config, linear))


def _of_any_gap(config: Config) -> Config:
    has_gap = any(one.name == "gap" for one in fields(config.contact))
    return varied(config, contact=replace(config.contact, gap="auto")) if has_gap else config


def shown(config: Config) -> Document:
    """A scene as its file has it, without the sections in which all is as usual."""
    usual = to_mapping(from_mapping(ANY_SCENE))
    said = {name: part for name, part in to_mapping(config).items() if part not in ({}, "")}
    return {
        name: part
        for name, part in said.items()
        if not (name in DEFAULTED and part == usual.get(name))
    }
