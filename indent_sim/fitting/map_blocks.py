"""Blocks of a map, whose curves are fitted in this process or in several child processes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from multiprocessing import connection

import numpy as np

from indent_sim.fitting.inference.pooled_noise import PooledNoise
from indent_sim.fitting.map_fit import MapFitter, MapModel, ReadSamples
from indent_sim.process.child_process import ChildProcess, ProcessCrash
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
        The map, which gets the results.
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
        idle = [ChildProcess(__name__) for _ in range(min(jobs, len(blocks)))]
        for process in idle:
            stack.callback(process.stop)
        answers = {
            process: process.begin_call(
                _begin_in_child, fitter.read, fitter.count, fitter.model, noise
            )
            for process in idle
        }
        for answer in answers.values():
            _receive(answer)
        busy: dict[ChildProcess, tuple[Callable[[], State], np.ndarray]] = {}
        waiting = list(reversed(blocks))
        while waiting or busy:
            while waiting and idle:
                process = idle.pop()
                block = waiting.pop()
                begun = process.begin_call(_fit_in_child, block, fitter.state(block))
                busy[process] = begun, block
            # Only as many objects as there are processes are compared.
            ready = set(map(id, connection.wait(list(busy))))  # type: ignore[arg-type]
            for process in [process for process in busy if id(process) in ready]:
                answer, block = busy.pop(process)
                idle.append(process)
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
        raise BackendError(
            f"a process that fits curves of the map {crash}; call the command again, which "
            "continues after the last finished block, with fewer --jobs"
        ) from None


# Map and noise of this child process, which are sent once for all blocks.
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
