"""Random scenes with friction at finite strain: alternating pressures are warned of."""

from __future__ import annotations

import pytest
from rubber_with_friction import drawn, judged

from indent_sim.run.measured_constants import MAX_ROUGHNESS


@pytest.mark.verify
@pytest.mark.parametrize("number", range(5))
def test_rough_pressures_are_warned_of(number: int) -> None:
    """Pressures that alternate from node to node do not pass without a warning.

    The measure here knows nothing of the facets on which the run's own measure is defined.
    """
    found = judged(drawn(1, number))
    assert found.warnings or found.alternation <= MAX_ROUGHNESS
