"""What scripts/make_fit_page makes of a few curves; the page's own take ten minutes."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(ROOT / "scripts" / "make_fit_page"))


def test_a_few_curves_hold_their_truth_at_the_bound(script):
    tally, sd = script["fitted"]("half-space", ("white",), 4)
    assert (
        tally.curves == 4 and tally.refused == 0 and sum(tally.held) >= 2
    )  # of 95 %: fewer once in 2000
    assert all(0.9 < width / (1.96 * sd) < 1.4 for width in tally.widths)


def test_all_noises_have_the_variance_that_is_said(script):
    """All noises have the variance 1 and a valid covariance, and 1/f noise is correlated for long.

    A correlation of 1/f has no time of its own: it falls by less than exp(-1) in a tenth of the
    record.
    """
    for name, noise in script["NOISES"].items():
        V = script["covariance"](noise, 300)
        np.testing.assert_allclose(np.diag(V), 1.0, rtol=1e-9, err_msg=name)
        assert np.linalg.eigvalsh(V)[0] > -1e-9
    assert script["covariance"](None, 300)[0, 30] > 0.3


def test_every_table_of_the_page_is_made(script):
    marked = [
        found[1]
        for found in script["MARKED"].findall(
            (ROOT / "docs" / "fit.md").read_text(encoding="utf-8")
        )
    ]
    assert marked == list(script["MADE"])
    assert script["table"](["a", "b"], [["1", "2"]]) == ["| a | b |", "| --- | --- |", "| 1 | 2 |"]
