"""Cache of forward models, which curves of similar depth share."""

from __future__ import annotations

from indent_sim.config.scene_file import to_mapping, to_yaml
from indent_sim.config.schema import Config
from indent_sim.fitting.forward_model.elastic_load_curve import plan_elastic_run
from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.forward_model.loop_forward_model import LoopForwardModel
from indent_sim.fitting.forward_model.measured_path_forces import MeasuredPath
from indent_sim.fitting.forward_model.parameter_grid import ForwardModelUnavailable
from indent_sim.fitting.forward_model.parameters import number_at
from indent_sim.fitting.forward_model.surrogate_load_curves import ForceSurrogate
from indent_sim.process.errors import ConfigError
from indent_sim.run.solvers.elastic_curve import is_self_similar


class ForwardModelCache:
    """Cache of forward models, shared by curves of similar depth.

    Parameters
    ----------
    surrogate
        Surrogate that gives the elastic forces; None to solve the scenes.
    """

    def __init__(self, surrogate: ForceSurrogate | None = None) -> None:
        self.surrogate = surrogate
        self._models: dict[
            tuple[str, tuple[str, ...], float, MeasuredPath | None], ForwardModel
        ] = {}

    def forward_model(
        self,
        config: Config,
        keys: tuple[str, ...],
        max_depth: float,
        measured_path: MeasuredPath | None = None,
    ) -> ForwardModel:
        """Return the forward model of a scene.

        Raises
        ------
        ForwardModelUnavailable
            If the scene has no solution at this depth.
        ConfigError
            If the scene is not valid at any depth.
        """
        # One solution of a self-similar scene gives the forces at all depths.
        has_one_solution = config.yields or (
            self.surrogate is None
            and is_self_similar(config)
            and not config.instrument.adhesion
            and measured_path is None
        )
        solved_depth = 0.0 if has_one_solution else max_depth
        # A loop is run to its own depths and back, whatever the loading of the scene is.
        document = {key: part for key, part in to_mapping(config).items() if key != "loading"}
        scene = str(document) if config.yields else to_yaml(config)
        cache_key = scene, keys, solved_depth, measured_path
        if cache_key not in self._models:
            max_models = 100
            if len(self._models) >= max_models:
                self._models.clear()
            self._models[cache_key] = _build_forward_model(
                config, keys, max_depth, measured_path, self.surrogate
            )
        model = self._models[cache_key]
        return model if model.max_depth == max_depth else model.copy_for_depth(max_depth)


def _build_forward_model(
    config: Config,
    keys: tuple[str, ...],
    max_depth: float,
    measured_path: MeasuredPath | None,
    surrogate: ForceSurrogate | None,
) -> ForwardModel:
    for key in keys:
        number_at(config, key)
    if config.yields:
        return LoopForwardModel(config, keys, max_depth)
    try:
        return ForwardModel(config, keys, max_depth, measured_path, surrogate)
    except ConfigError as error:
        # A scene that is not valid at its own depth either is an error of the scene.
        plan_elastic_run(config, _scene_depth(config))
        raise ForwardModelUnavailable(
            f"the scene is not valid at a depth of {max_depth:.4g}: {error.problem}"
        ) from error


def _scene_depth(config: Config) -> float:
    """Return a depth at which the unchanged scene must be valid."""
    loading = config.loading
    return loading.delta or max(loading.deltas or (0.0,)) or 1e-3 * _characteristic_length(config)


def _characteristic_length(config: Config) -> float:
    height = getattr(config.body, "height", None)
    return float(height or getattr(config.indenter, "R", None) or 1.0)
