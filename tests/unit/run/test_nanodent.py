"""Hardness of twenty loops by this program and by nanodent, which others wrote.

nanodent fits the power law to samples that it is given, and takes the depth of the largest force
from its fit. It has no factor beta, and reads the noise of neither force nor depth.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from indentation_loops import Loop, Sample, loop

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.results.reader import read
from indent_sim.run.hardness_analysis import Hardness, HardnessOptions, analyse
from indent_sim.run.pipeline import simulate

nanodent = pytest.importorskip(
    "nanodent", reason="pip install nanodent, or the extra `comparison`, for this comparison"
)

# Sample, largest force [mN], samples of the hold, and noise relative to the largest force.
LOOPS: dict[str, tuple[Sample, float, int, float]] = {
    "fused silica": (Sample(72.0, 9.3, 0.17, 1.27), 10.0, 100, 0.0),
    "fused silica, shallow": (Sample(72.0, 9.3, 0.17, 1.27), 0.1, 0, 0.0),
    "fused silica, noise": (Sample(72.0, 9.3, 0.17, 1.27), 10.0, 100, 5e-4),
    "soda-lime glass": (Sample(72.0, 5.9, 0.23, 1.3), 50.0, 100, 0.0),
    "steel": (Sample(210.0, 4.0, 0.3, 1.5), 10.0, 100, 0.0),
    "steel, deep": (Sample(210.0, 4.0, 0.3, 1.5), 500.0, 0, 0.0),
    "steel, noise": (Sample(210.0, 4.0, 0.3, 1.5), 10.0, 100, 5e-4),
    "titanium": (Sample(116.0, 3.2, 0.32, 1.7), 10.0, 100, 0.0),
    "aluminium": (Sample(70.0, 0.5, 0.35, 1.38), 10.0, 100, 0.0),
    "copper": (Sample(120.0, 1.2, 0.34, 1.25), 3.0, 100, 0.0),
    "tungsten": (Sample(410.0, 4.2, 0.28, 1.6), 10.0, 0, 0.0),
    "silicon": (Sample(170.0, 12.0, 0.22, 1.4), 5.0, 100, 0.0),
    "sapphire": (Sample(410.0, 28.0, 0.25, 1.47), 20.0, 100, 0.0),
    "nickel, noise": (Sample(205.0, 2.0, 0.31, 1.45), 10.0, 100, 5e-4),
    "PMMA": (Sample(4.0, 0.25, 0.38, 1.8), 1.0, 100, 0.0),
    "polymer, noise": (Sample(2.0, 0.1, 0.4, 2.0), 1.0, 100, 5e-4),
}
TIPS: dict[str, dict[str, Any]] = {
    "elastic cone": {"shape": "cone", "half_angle": 70.3},
    "elastic blunt cone": {"shape": "cone", "half_angle": 80.0},
    "elastic paraboloid": {"shape": "paraboloid", "R": 1.0},
    "elastic sphere": {"shape": "sphere", "R": 1.0},
}
COMPARED = {
    "S": ("stiffness_uN_per_nm", 1.0),
    "h_c": ("contact_depth_nm", 1.0),
    "A_p": ("contact_area_nm2", 1.0),
    "H_IT": ("hardness_uN_per_nm2", 1e3),
    "E_r": ("reduced_modulus_uN_per_nm2", 1e3),
}


def assert_equal(
    found: Hardness, h: np.ndarray, F: np.ndarray, tolerance: float, **options: Any
) -> None:
    """Compare a result with nanodent's for unloading at depths h [nm] and forces F [uN] (n,).

    The first sample is the deepest one.
    """
    used = (0.98 * F[0] >= F) & (0.40 * F[0] <= F)
    used[0] = True
    other = nanodent.analyze_oliver_pharr(h[used], F[used], onset_disp_nm=0.0, **options)
    assert other.hardness_success, other
    for name, (attribute, factor) in COMPARED.items():
        assert found.values[name] == pytest.approx(
            factor * getattr(other, attribute), rel=tolerance
        )


def written(folder: Path, made: Loop) -> Path:
    """Write a loop in nm and uN, with all digits."""
    rows = zip(made.t.tolist(), made.h.tolist(), (1e3 * made.F).tolist(), strict=True)
    path = folder / "loop.csv"
    path.write_text(
        "\n".join(["Time [s],Depth [nm],Load [uN]", *(f"{t},{h},{F}" for t, h, F in rows)])
    )
    return path


@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.parametrize(("epsilon", "worn"), [(0.75, 0.0), (0.72, 2.0e3)])
def test_synthetic_loops(tmp_path: Path, name: str, epsilon: float, worn: float) -> None:
    """The ideal Berkovich tip, and A = 24.494 h^2 + 2000 nm h with another epsilon.

    Both fit an exact power law; the table of the area function is interpolated with an error of
    1e-6. With noise of 0.05 % the largest force is a mean of the hold here and a sample there, and
    the weights of the two fits differ: 0.5 %.
    """
    sample, F_max, hold_rows, noise = LOOPS[name]
    exact = loop(sample, F_max=F_max, hold_rows=hold_rows, rows=400)
    white = np.random.default_rng(7).standard_normal((2, len(exact.h)))
    made = replace(
        exact, h=exact.h + noise * exact.h_max * white[0] / 10, F=exact.F + noise * F_max * white[1]
    )
    depths = np.geomspace(0.3 * exact.h_c, 3 * exact.h_c, 400)
    table = tmp_path / "area.csv"
    areas = (f"{h},{24.494 * h**2 + worn * h}" for h in depths.tolist())
    table.write_text("\n".join(["h_c [nm],A [nm^2]", *areas]))
    found = analyse(
        written(tmp_path, made), HardnessOptions(area=str(table), nu=0.3, epsilon=str(epsilon))
    )
    deepest = 400 + hold_rows - 1
    area = nanodent.TipAreaFunction(c0=24.494, c1=worn)
    fall = slice(deepest, None)
    assert_equal(
        found,
        made.h[fall],
        1e3 * made.F[fall],
        5e-3 if noise else 1e-5,
        epsilon=epsilon,
        tip_area_function=area,
    )


@pytest.mark.parametrize("name", TIPS)
def test_simulated_loops(tmp_path: Path, name: str) -> None:
    """Loops by theory whose unloading has twenty rows.

    nanodent fits the deepest row, too; that of a sphere is no exact power law: 1e-3.
    """
    depths = [0.02 * k for k in range(1, 11)] + [0.2 - 0.005 * k for k in range(1, 21)]
    scene = {
        "units": {"length": "nm", "force": "uN"},
        "body": {"shape": "half_space"},
        "material": {"model": "linear_elastic", "E": "72 GPa", "nu": 0.17},
        "indenter": {
            key: 1e3 * value if key == "R" else value for key, value in TIPS[name].items()
        },
        "loading": {"deltas": [1e3 * depth for depth in depths]},
        "output": {"plot": False},
    }
    simulate(config_from_mapping(scene), directory=tmp_path / "out")
    found = analyse(tmp_path / "out", HardnessOptions(area="berkovich"))
    rows = read(tmp_path / "out")
    area = nanodent.TipAreaFunction(c0=24.4944)
    assert_equal(found, rows["delta"][9:], rows["force"][9:], 1e-3, tip_area_function=area)
