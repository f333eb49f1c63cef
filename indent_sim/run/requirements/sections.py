"""Sections of a scene as its file has them, and what a simpler or a richer model has in their place."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from indent_sim.config.file import from_mapping, to_mapping

Document = dict[str, Any]  # a scene as nested mappings, shaped like its file

DEFAULTED = ("units", "contact", "mesh", "solver", "output")  # sections left out of a scene where all is as usual
ANY_SCENE: Document = {"body": {"shape": "half_space"}, "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.0},
                       "indenter": {"shape": "sphere", "R": 1.0}, "loading": {"delta": 0.1}}  # fmt: skip


def half_space_of(body: Document) -> Document:
    """The half-space of a body's matter: the last of its layers goes on without end."""
    layers = [dict(layer) for layer in body.get("layers") or []]
    for layer in layers[-1:]:
        layer.pop("thickness", None)
    return {"shape": "half_space"} | ({"layers": layers} if layers else {})


def section_of(item: Any) -> Document:
    """A tip or a material as the section of a file, its tag first."""
    fields = {f.name: getattr(item, f.name) for f in dataclasses.fields(item)}
    tag = next(name for name in ("shape", "model") if name in fields)
    return {tag: fields[tag]} | {name: list(map(list, value)) if name == "points" else value
                                 for name, value in fields.items() if name != tag and value is not None}  # fmt: skip


def _matter_of(section: Document) -> Any:
    """The material of a section, by its small-strain constants."""
    return from_mapping(ANY_SCENE | {"material": section}).material.canonical()  # type: ignore[union-attr]


def small_strain_law(section: Document) -> Document:
    """The linear elastic material of equal constants."""
    matter = _matter_of(section)
    if matter.small_strain and not matter.is_isotropic:
        return section
    return {"model": "linear_elastic"} | _constants(matter)


def finite_strain_law(section: Document) -> Document:
    """The finite-strain law of a material: its own, or neo-Hookean with the same constants."""
    matter = _matter_of(section)
    if not matter.small_strain:
        return section
    return {"model": "neo_hookean"} | _constants(matter)


def _constants(matter: Any) -> Document:
    """E and nu to twelve digits, as what came of other constants has no more."""
    return {name: float(f"{value:.12g}") for name, value in zip(("E", "nu"), matter.constants, strict=True)}


def changed(body: Document, change: Callable[[Document], Document]) -> Document:
    """A body with its materials changed, those of layers, regions and inclusions."""
    found = dict(body)
    for name in ("layers", "inclusions"):
        if found.get(name):
            found[name] = [part | ({"material": change(part["material"])} if part.get("material") else {})
                           for part in found[name]]  # fmt: skip
    if found.get("regions"):
        found["regions"] = {name: change(part) for name, part in found["regions"].items()}
    return found


def at_small_strain(body: Document) -> Document:
    """A body with linear elastic materials of equal constants."""
    return changed(body, small_strain_law)


def of_strain(document: Document, is_finite: bool) -> Document:
    """A scene whose materials and gap are of finite strain, or of small."""
    change = finite_strain_law if is_finite else small_strain_law
    found = document | {"body": changed(document["body"], change)}
    if found.get("material"):
        found["material"] = change(found["material"])
    if "gap" in found.get("contact", {}):
        found["contact"] = found["contact"] | {"gap": "auto"}
    if is_finite:  # a nonlinear body is solved whole, and no curve determines its experiment
        found = {key: value for key, value in found.items() if key not in ("solver", "experiment")}
    return found


def is_small(document: Document) -> bool:
    """Whether all materials of a scene are of small strain."""
    parts = [document.get("material"), *(layer.get("material") for layer in document["body"].get("layers") or [])]
    return all(_matter_of(part).small_strain for part in parts if part)


def usual(document: Document) -> Document:
    """A scene without the sections in which all is as usual."""
    usual = to_mapping(from_mapping(ANY_SCENE))
    return {name: part for name, part in document.items()
            if part not in ({}, "") and not (name in DEFAULTED and part == usual.get(name))}  # fmt: skip
