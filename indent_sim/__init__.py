"""indent-sim: simulation of rigid, analytic indenters pressed into elastic bodies, with an error
estimate of each number.

Functions for scripts and notebooks: `load` reads a scene from a file or a dictionary, `resolve`
makes a Scene of it, `states` solves the Scene step by step, `condense` condenses its body,
`simulate` writes a result folder, and `read` reads one. `plan`, `require`, `study`, `compare`,
`hardness`, `plot` and `fit` are the commands of the same names. `fit_map` fits a map of curves,
`surrogate` reads a fitted surrogate of a study, and `sensitivities` returns derivatives of the
force.
"""

# No module is imported here, not even `typing`: Ctrl-C until the program has started would be a
# traceback.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from typing import Any

    from indent_sim.cli.calls import (
        compare,
        fit,
        hardness,
        plan,
        plot,
        read,
        require,
        sensitivities,
        study,
    )
    from indent_sim.config.scene_file import load
    from indent_sim.fitting.notebook import fit_map
    from indent_sim.process.version import VERSION as __version__
    from indent_sim.run.pipeline import condense, simulate, states
    from indent_sim.scene.scene import resolve
    from indent_sim.studies.surrogate import read_surrogate as surrogate


__all__ = [
    "__version__",
    "compare",
    "condense",
    "fit",
    "fit_map",
    "hardness",
    "load",
    "plan",
    "plot",
    "read",
    "require",
    "resolve",
    "sensitivities",
    "simulate",
    "states",
    "study",
    "surrogate",
]


def __getattr__(name: str) -> "Any":
    """Import a public name at its first use, because loading a scene needs no solver."""
    if name == "__version__":
        from indent_sim.process.version import VERSION

        return VERSION
    if name == "load":
        from indent_sim.config.scene_file import load

        return load
    if name == "resolve":
        from indent_sim.scene.scene import resolve

        return resolve
    if name == "fit_map":
        from indent_sim.fitting.notebook import fit_map

        return fit_map
    if name == "surrogate":
        from indent_sim.studies.surrogate import read_surrogate

        return read_surrogate
    if name in ("simulate", "states", "condense"):
        from indent_sim.run import pipeline

        return getattr(pipeline, name)
    if name in __all__:
        from indent_sim.cli import calls

        return getattr(calls, name)
    raise AttributeError(f"module 'indent_sim' has no name {name!r}")


def __dir__() -> list[str]:
    """The public names."""
    return __all__
