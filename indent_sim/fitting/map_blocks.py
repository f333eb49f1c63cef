"""Blocks of a map, whose curves are fitted in this process or in several child processes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack

import numpy as np

from indent_sim.fitting.inference.pooled_noise import PooledNoise
from indent_sim.fitting.map_fit import MapFitter, MapModel, ReadSamples
from indent_sim.process.child_process import ChildProcess, ProcessCrash, run_calls
from indent_sim.process.errors import BackendError

State = Mapping[str, np.ndarray]


def fit_blocks(
    fitter: MapFitter,
    blocks: Sequence[np.ndarray],
    noise: PooledNoise | None,
    jobs: int,
    on_block: Callable[[np.ndarray], None],
) -> None:
    """Fit the curves of some blocks.

    Parameters
    ----------
    fitter
        The map, to which the results are written.
    blocks
        Indices of the curves of each block.
    noise
        The noise of the map; None for fits by ordinary least squares.
    jobs
        Number of processes.
    on_block
        Function that is called with each block whose results are in `fitter`.

    Raises
    ------
    BackendError
        If a process crashes.
    """
    if jobs == 1 or len(blocks) == 1:
        for block in blocks:
            _fit_block(fitter, block, noise)
            on_block(block)
        return
    with ExitStack() as stack:
        processes = [ChildProcess(__name__) for _ in range(min(jobs, len(blocks)))]
        for process in processes:
            stack.callback(process.stop)
        model = (fitter.read, fitter.count, fitter.model, noise)
        for begun in [process.begin_call(_begin_in_child, *model) for process in processes]:
            _receive(begun)
        calls = ((block, _fit_in_child, (block, fitter.state(block))) for block in blocks)
        for block, answer in run_calls(processes, calls):
            fitter.restore(block, _receive(answer))
            on_block(block)


def _fit_block(fitter: MapFitter, block: np.ndarray, noise: PooledNoise | None) -> None:
    if noise is None:
        fitter.fit_block_initially(block)
    else:
        fitter.fit_block(block, noise)


def _receive(answer: Callable[[], State]) -> State:
    try:
        return answer()
    except ProcessCrash as crash:
        raise process_crash(crash) from None


def process_crash(crash: ProcessCrash) -> BackendError:
    """Return the error of a process that ended before it had fitted its curves."""
    return BackendError(
        f"a process that fits curves of the map {crash}; call the command again with fewer --jobs: "
        "it continues after the last finished block"
    )


# Map and noise in this child process; they are sent to it only once, for all blocks.
_fitter_of_child: list[tuple[MapFitter, PooledNoise | None]] = []


def _begin_in_child(
    read: ReadSamples, count: int, model: MapModel, noise: PooledNoise | None
) -> State:
    """Keep the map for the calls of `_fit_in_child`."""
    _fitter_of_child[:] = [(MapFitter(read, count, model), noise)]
    return {}


def _fit_in_child(block: np.ndarray, state: State) -> State:
    """Fit a block whose earlier results are given, and return its results."""
    [(fitter, noise)] = _fitter_of_child
    fitter.restore(block, state)
    _fit_block(fitter, block, noise)
    return fitter.state(block)
