"""Checks of materials: constants, pore flow, gels and relaxation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from math import isclose

from indent_sim.config.scene_sections import SceneSections
from indent_sim.model.contact import Nitsche
from indent_sim.model.drainage import Drainage
from indent_sim.model.gel import Gel
from indent_sim.model.hyperelasticity import NeoHookean
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.materials import Material, ShearRelaxingLaw
from indent_sim.model.relaxation import Relaxation
from indent_sim.process.errors import ConfigError


def material_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in the constants of each material."""
    for key, material in config.materials():
        try:
            material.canonical()
        except ArithmeticError:
            yield ConfigError(key, "no stable material has these constants")
        except ValueError as error:
            yield ConfigError(key, str(error))


def flow_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in the pore flow: missing keys, and keys that cannot be combined with it."""
    flows = {f"{key}.flow": material for key, material in config.materials() if material.flow}
    if config.loading.per_doubling is not None and not any(
        material.is_time_dependent for _, material in config.materials()
    ):
        problem = (
            "applies to time-dependent bodies, but no material of this body has a flow, creeps or "
            "relaxes in shear only"
        )
        yield ConfigError("loading.per_doubling", problem, "leave it out")
    if not flows:
        if config.drainage and not (
            _has_own_bath(config) and config.drainage == Drainage(bath=config.drainage.bath)
        ):
            yield ConfigError(
                "drainage", "no material has a flow", "give material.flow, or leave it out"
            )
        elif config.drainage and not isinstance(config.drainage.bath, float | int):
            yield ConfigError(
                "drainage.bath", "changes in time, but no material has a flow", "give material.flow"
            )
        yield from _gel_errors(config)
        return
    key = next(iter(flows))
    if config.loading.prescribed_history is None:
        remedy = (
            "give loading.history, or leave flow out: without flow the given nu describes the "
            "drained body, and nu: 0.5 the undrained body"
        )
        yield ConfigError(key, "needs a load path in time", remedy)
    yield from (
        error for key, material in flows.items() for error in _flow_law_errors(key, material)
    )
    yield from _gel_errors(config)
    if isinstance(config.contact, Nitsche):
        problem = (
            "nitsche uses the stress of the solid, but with pore fluid this is not the total stress"
        )
        yield ConfigError("contact.method", problem, "use augmented_lagrangian")
    drainage = config.drainage or Drainage()
    if isinstance(config.body, MeshFromFile) and drainage.sides != "sealed":
        problem = (
            "cannot be drained for a body from a mesh file: its sides have no names by which their "
            "facets could be found"
        )
        yield ConfigError("drainage.sides", problem, "use sealed")
    times = [t for t, _ in drainage.bath] if isinstance(drainage.bath, tuple) else []
    backward_index = next(
        (k for k, (earlier, later) in enumerate(pairwise(times), start=1) if later <= earlier), None
    )
    if backward_index is not None:
        yield ConfigError(
            f"drainage.bath[{backward_index}]",
            f"time does not increase from {times[backward_index - 1]:g} to "
            f"{times[backward_index]:g}",
        )


def _has_own_bath(config: SceneSections) -> bool:
    """Return whether the stretch of a gel is the swelling equilibrium in its bath."""
    return any(
        isinstance(material, Gel) and material.stretch == "auto"
        for _, material in config.materials()
    )


def _gel_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in gels, which all have the same bath and solvent."""
    gels = {key: material for key, material in config.materials() if isinstance(material, Gel)}
    for key, gel in gels.items():
        try:
            gel.with_free_swelling(config.initial_bath).canonical()
        except ValueError as error:
            yield ConfigError(f"{key}.stretch", str(error))
        if gel.relaxation:
            yield ConfigError(f"{key}.relaxation", "is not verified for a gel", "leave it out")
    for key, material in config.materials():
        if gels and material.flow and not isinstance(material, Gel):
            problem = (
                "cannot be combined with a gel unless this material is a gel, too, because the "
                "bath of a gel is the chemical potential of its solvent"
            )
            yield ConfigError(f"{key}.flow", problem, "leave it out, or use only gels")
    ratios = {key: gel.G / gel.n_omega for key, gel in gels.items() if gel.flow}
    first = next(iter(ratios.values()), 0.0)
    # Largest relative difference of kT over the molecular volume of two equal solvents.
    solvent_rtol = 1e-6
    for key, ratio in ratios.items():
        if not isclose(ratio, first, rel_tol=solvent_rtol):
            problem = (
                f"gives G/n_omega = {ratio:g}, but another gel has {first:g}; this ratio is kT "
                "divided by the molecular volume of the solvent, which is the same for all gels"
            )
            yield ConfigError(f"{key}.n_omega", problem, "use the same ratio for all gels")


def _flow_law_errors(key: str, material: Material) -> Iterator[ConfigError]:
    """Yield errors in the flow of one material."""
    flow = material.flow
    assert flow
    if isinstance(material, Gel):
        remedy = "give the diffusivity of the solvent"
        if flow.permeability is not None:
            problem = "of a gel follows from its swelling"
            yield ConfigError(f"{key}.permeability", problem, remedy)
        elif flow.diffusivity is None:
            yield ConfigError(f"{key}.diffusivity", "is missing", remedy)
        if flow.holmes_mow:
            yield ConfigError(
                f"{key}.holmes_mow",
                "does not apply to a gel, whose permeability follows from its swelling",
                "leave it out",
            )
    if not material.is_small_strain and (flow.alpha, flow.storage) != (1.0, 0.0):
        name = "alpha" if flow.alpha != 1 else "storage"
        problem = "at finite strain grains and fluid must be incompressible"
        yield ConfigError(f"{key}.{name}", problem, "use alpha: 1, storage: 0")
    if material.is_small_strain and flow.holmes_mow:
        yield ConfigError(
            f"{key}.holmes_mow", "applies to laws of finite strain only", "leave it out"
        )


def plasticity_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield a ConfigError for each error in the plasticity of the materials.

    Keys that cannot be combined with plasticity are errors as well.
    """
    laws = {f"{key}.plasticity": law for key, law in config.materials() if law.plasticity}
    for key, law in laws.items():
        yield from _hardening_errors(key, law)
    if not laws:
        return
    key = next(iter(laws))
    for law_key, law in config.materials():
        for slot, verb in (("relaxation", "relaxes"), ("flow", "drains")):
            if getattr(law, slot):
                problem = f"a body that both yields and {verb} is not modelled"
                yield ConfigError(f"{law_key}.{slot}", problem, f"leave it or {key} out")
    creeps = any(law.creeps for law in laws.values())
    if creeps and config.loading.prescribed_history is None:
        remedy = "give loading.history or loading.force_history"
        creep_key = next(key for key, law in laws.items() if law.creeps)
        yield ConfigError(f"{creep_key}.creep", "needs a load path in time", remedy)
    if config.contact.may_snap_through or (config.experiment and config.experiment.adhesion):
        section = "contact" if config.contact.may_snap_through else "experiment"
        problem = "is not verified together with yield"
        yield ConfigError(f"{section}.adhesion", problem, f"leave it or {key} out")
    elif config.experiment and config.experiment.frequencies:
        problem = "is computed from the load curve of a linear elastic body, but this body yields"
        yield ConfigError("experiment.frequencies", problem, "leave it out")
    refines_increments = config.loading.given_path_keys[:1] in (("delta",), ("deltas",))
    if config.accuracy is not None and not refines_increments:
        problem = "can refine the increments of a body that yields only if depths are prescribed"
        yield ConfigError(
            "accuracy", problem, "prescribe depths, or use --error-bars in place of accuracy"
        )
    if isinstance(config.contact, Nitsche):
        problem = "nitsche uses the stress of the body, which yields"
        yield ConfigError("contact.method", problem, "use augmented_lagrangian")
    if getattr(config.body, "surface_tension", 0.0):
        problem = "is not verified together with yield"
        yield ConfigError("body.surface_tension", problem, f"leave it or {key} out")


def _hardening_errors(key: str, law: Material) -> Iterator[ConfigError]:
    """Yield a ConfigError for each error in the plasticity of one material."""
    plasticity = law.plasticity
    assert plasticity
    hardening = plasticity.hardening
    laws = hardening.laws if hardening else ()
    remedy = "give one of n, linear and voce, or no hardening for perfect plasticity"
    if plasticity.short_laws and hardening:
        yield ConfigError(
            f"{key}.{plasticity.short_laws[0]}",
            f"is a second hardening law beside {key}.hardening",
            "leave it out; it is the short form of hardening",
        )
    elif len(plasticity.short_laws) > 1:
        first, second = plasticity.short_laws[:2]
        yield ConfigError(f"{key}.{second}", f"is a second hardening law beside {first}", remedy)
    elif len(laws) > 1:
        yield ConfigError(
            f"{key}.hardening.{laws[1]}", f"is a second hardening law beside {laws[0]}", remedy
        )
    elif hardening and not laws:
        yield ConfigError(f"{key}.hardening", "gives no law", remedy)
    try:
        E = law.canonical().constants.E
    except (ArithmeticError, ValueError):
        return  # reported by `material_errors`
    voce = hardening.voce if hardening else None
    if voce and voce.rise > E * voce.strain:
        yield ConfigError(
            f"{key}.hardening.voce",
            f"rise/strain = {voce.rise / voce.strain:g}, the hardening modulus at first yield, "
            f"exceeds Young's modulus {E:g}",
            "use a smaller rise or a larger strain",
        )


def relaxation_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in the relaxation of the materials."""
    laws = dict(config.materials())
    frequencies = config.experiment and config.experiment.frequencies
    history = config.loading.prescribed_history
    relaxations = {
        f"{key}.relaxation": law.relaxation for key, law in laws.items() if law.relaxation
    }
    if not relaxations:
        if frequencies:
            yield ConfigError(
                "experiment.frequencies",
                "needs a material with relaxation",
                "give material.relaxation",
            )
        return
    yield from (
        error
        for key, given in relaxations.items()
        for error in _relaxation_law_errors(config, key, given)
    )
    key, given = next(iter(relaxations.items()))
    if any(law.has_shear_relaxation for law in laws.values()):
        yield from _shear_relaxation_errors(config, laws)
    elif different_key := next(
        (different_key for different_key, law in laws.items() if law.relaxation != given), None
    ):
        problem = (
            f"differs from {different_key}.relaxation: with of: all, every material must have the "
            "same relaxation"
        )
        yield ConfigError(key, problem, "use the same relaxation, or of: shear")
    if not history and not frequencies:
        remedy = "give loading.history, loading.force_history or experiment.frequencies"
        yield ConfigError(key, "needs a load path in time", remedy)


def _shear_relaxation_errors(
    config: SceneSections, laws: Mapping[str, Material]
) -> Iterator[ConfigError]:
    """Yield an error for each key that cannot be combined with relaxation in shear only."""
    for key, law in laws.items():
        if law.relaxation and law.relaxation.of == "all":
            problem = (
                "'all' needs the same relaxation in every material, but another material relaxes "
                "in shear only"
            )
            yield ConfigError(f"{key}.relaxation.of", problem, "use of: shear")
        if law.relaxation and not isinstance(law, ShearRelaxingLaw | Gel):
            alternative_law = (
                "mooney_rivlin with C10 = mu/2" if isinstance(law, NeoHookean) else "linear_elastic"
            )
            yield ConfigError(
                f"{key}.relaxation.of",
                f"is not available for {law.model}, because the shear part of its energy depends "
                "on the volume",
                f"use {alternative_law}",
            )
    if config.experiment and config.experiment.frequencies:
        problem = (
            "needs an elastic load curve, which does not describe a body whose shear relaxes at "
            "constant bulk modulus"
        )
        yield ConfigError("experiment.frequencies", problem, "use of: all")
    if isinstance(config.contact, Nitsche):
        problem = "nitsche uses the stress of the body, which relaxes"
        yield ConfigError("contact.method", problem, "use augmented_lagrangian")
    if config.contact.may_snap_through:
        problem = "is not verified together with relaxation"
        yield ConfigError("contact.adhesion", problem, "leave one of the two out")


def _relaxation_law_errors(
    config: SceneSections, key: str, given: Relaxation
) -> Iterator[ConfigError]:
    """Yield errors in a relaxation law, and in a history that is incompatible with it."""
    if (given.prony is None) == (given.power_law is None):
        yield ConfigError(key, "needs exactly one of its two laws", "give prony or power_law")
    for k, (fraction, time) in enumerate(given.prony or ()):
        if not (0 <= fraction < 1 and time > 0):
            problem = (
                f"[{fraction:g}, {time:g}] is not a term [fraction of the instantaneous modulus, "
                "time]"
            )
            yield ConfigError(
                f"{key}.prony[{k}]",
                problem,
                "use a fraction that is at least 0 and below 1, and a time above 0",
            )
    if (total := sum(fraction for fraction, _ in given.prony or ())) >= 1:
        yield ConfigError(
            f"{key}.prony",
            f"the fractions sum to {total:g}: the modulus would relax to zero or below",
            "use fractions with a sum below 1",
        )
    history = config.loading.prescribed_history
    if given.power_law and history and history.has_jumps:
        problem = "jumps, but the instantaneous modulus of a power law is infinite"
        yield ConfigError(f"loading.{config.loading.given_path_keys[0]}", problem, "use a ramp")
