"""Random scenes with friction at finite strain: no pressure alternates from node to node without a
word.
"""

from __future__ import annotations

import pytest
from rubber_with_friction import drawn, judged

from indent_sim.run.row_warnings import MAX_ROUGHNESS


@pytest.mark.verify
@pytest.mark.parametrize("number", range(5))
def test_rough_pressures_are_warned_of(number: int) -> None:
    """By a measure that knows nothing of the facets of which the run's own measure is made."""
    found = judged(drawn(1, number))
    assert found.warnings or found.alternation <= MAX_ROUGHNESS
