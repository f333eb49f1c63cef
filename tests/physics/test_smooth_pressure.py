"""The contact pressure on rubber with friction has no saw-tooth from one node to the next."""

from __future__ import annotations

import pytest
from scenes import scene, solve

PUNCH = {"shape": "flat_punch", "radius": 1.0, "edge_radius": 0.2}
LAYER = {"shape": "cylinder", "radius": 8.0, "height": 1.0, "base": "fixed", "sides": "free"}


def test_shear_along_the_surface_leaves_no_saw_tooth() -> None:
    """The pressure on a rubber layer under a rounded punch with friction is smooth.

    At C01 = C10 normal and mean stress differ most. The roughness is that of `observe.roughness`:
    0.016 is found, and a run warns from 0.03 on. On elements that were small at the rim of the
    contact alone it was 0.1, and with the mean stress for the field q several times that.
    """
    rubber = {"model": "mooney_rivlin", "C10": 3.5, "C01": 3.5, "nu": 0.49}
    (state,) = solve(
        scene(
            LAYER,
            material=rubber,
            indenter=PUNCH,
            contact={"friction": 0.3},
            loading={"deltas": [0.3]},
        )
    )
    assert 0 < state.roughness < 0.03
    # With mesh h_contact 0.05 and h_edge 0.01 and 0.0025, a half and twice as fine at the edge as
    # here, p_max is 59.38 and 58.895: of second order its limit is 58.86, from which 0.3 % remain
    # here. On elements of 0.02 to 0.06 along the rounded edge it was 4 to 6 % too large.
    assert state.p_max == pytest.approx(58.86, rel=0.01)
