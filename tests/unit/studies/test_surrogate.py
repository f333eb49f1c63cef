"""Surrogates of studies: groups from dimensions, range, polynomial, error."""

from __future__ import annotations

import itertools
import json
from fractions import Fraction

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.optimize import linprog
from surrogate_tables import RANGES, SCENE, hertz, study_with_table

from indent_sim import studies
from indent_sim.config.key_dimensions import key_numbers
from indent_sim.process.errors import UsageError, VerificationError
from indent_sim.studies.chebyshev_sum import ChebyshevSum, design_matrix, index_tuples
from indent_sim.studies.dimensionless_groups import find_groups, powers_text
from indent_sim.studies.surrogate import read_surrogate, write_surrogate
from indent_sim.studies.surrogate_fit import fit_surrogate
from indent_sim.studies.zonotope import Zonotope

LENGTH, FORCE, PRESSURE, TIME, NONE = (1, 0, 0), (0, 1, 0), (-2, 1, 0), (0, 0, 1), (0, 0, 0)


class TestGroups:
    def test_moduli_and_the_tip_are_eliminated(self):
        varied = {
            "loading.delta": LENGTH,
            "material.nu": NONE,
            "body.height": LENGTH,
            "indenter.R": LENGTH,
            "material.E": PRESSURE,
        }
        groups = find_groups(varied, {}, FORCE)
        assert [powers_text(powers) for powers in groups.varied] == [
            "loading.delta / indenter.R",
            "material.nu",
            "body.height / indenter.R",
        ]
        assert powers_text(groups.scale) == "material.E indenter.R^2"
        assert groups.constant == ()

    def test_fixed_keys_are_used_first(self):
        """R is compared with the fixed height: no varied length needs to be eliminated."""
        groups = find_groups(
            {"indenter.R": LENGTH, "material.E": PRESSURE},
            {"body.height": LENGTH, "loading.delta": LENGTH},
            FORCE,
        )
        assert [powers_text(powers) for powers in groups.varied] == ["indenter.R / body.height"]
        assert [powers_text(powers) for powers in groups.constant] == [
            "loading.delta / body.height"
        ]
        assert powers_text(groups.scale) == "body.height^2 material.E"

    def test_times_and_fractional_powers(self):
        """A diffusivity of length^2/time: sqrt(D t) is a length."""
        groups = find_groups({"D": (2, 0, -1), "R": LENGTH, "t": TIME, "E": PRESSURE}, {}, LENGTH)
        assert len(groups.varied) == 1
        powers = {"D": (2, 0, -1), "R": LENGTH, "t": TIME, "E": PRESSURE}
        for group in groups.varied:
            total = np.sum(
                [[float(p) * d for d in powers[key]] for key, p in group.items()], axis=0
            )
            assert np.allclose(total, 0)
        scale = np.sum(
            [[float(p) * d for d in powers[key]] for key, p in groups.scale.items()], axis=0
        )
        assert np.allclose(scale, LENGTH)

    def test_a_force_needs_a_force(self):
        with pytest.raises(ValueError, match="dimension of the column"):
            find_groups({"R": LENGTH}, {}, FORCE)

    def test_every_group_has_no_dimension(self):
        """Random dimensions: groups and scale are checked by their definition."""
        random = np.random.default_rng(1)
        for _ in range(200):
            names = "abcdefg"[: random.integers(2, 8)]
            dimensions = {name: tuple(map(int, random.integers(-2, 3, 3))) for name in names}
            fixed = {name: dimensions[name] for name in names[: random.integers(0, 3)]}
            varied = {name: dimensions[name] for name in names if name not in fixed}
            column = dimensions[names[-1]]
            groups = find_groups(varied, fixed, column)
            for powers in (*groups.varied, *groups.constant):
                total = [
                    sum((power * dimensions[key][i] for key, power in powers.items()), Fraction(0))
                    for i in range(3)
                ]
                assert total == [0, 0, 0]
            rank = np.linalg.matrix_rank(np.array(list(dimensions.values())))
            assert len(groups.varied) + len(groups.constant) == len(names) - rank

    def test_dimensions_of_a_scene(self):
        numbers = key_numbers(SCENE)
        assert numbers["material.E"].dimension == PRESSURE
        assert numbers["indenter.R"].dimension == LENGTH
        assert numbers["material.nu"].dimension == NONE
        flat = SCENE | {"body": {"shape": "strip", "width": 2.0, "height": 1.0}}
        # In plane strain a force is one per length.
        assert key_numbers(flat)["material.E"].dimension == (-1, 1, 0)


class TestZonotope:
    @pytest.mark.parametrize(("count", "dimension"), [(2, 1), (4, 2), (5, 3), (6, 4), (3, 3)])
    def test_against_linear_programming(self, count, dimension):
        """A point is inside if some s in the box gives it: a linear program decides."""
        random = np.random.default_rng(count)
        generators = random.normal(size=(count, dimension))
        zonotope = Zonotope(np.zeros(dimension), generators)
        points = random.normal(size=(60, dimension)) * zonotope.half_widths / dimension
        expected = [
            linprog(
                np.zeros(count), A_eq=generators.T, b_eq=point, bounds=[(-1, 1)] * count
            ).success
            for point in points
        ]
        assert 2 < sum(expected) < 60
        assert zonotope.contains(points).tolist() == expected


class TestChebyshevSum:
    @pytest.mark.parametrize("degrees", [(5,), (4, 3), (3, 5, 2), (2, 2, 3, 2), (3, 1, 1, 1, 2)])
    def test_against_numpy(self, degrees):
        random = np.random.default_rng(0)
        indices = index_tuples(degrees)
        coefficients = random.normal(size=len(indices))
        points = random.uniform(-1, 1, (9000, len(degrees)))
        expected = sum(
            c
            * np.prod(
                [
                    chebyshev.chebval(x, np.eye(k + 1)[k])
                    for x, k in zip(points.T, index, strict=True)
                ],
                axis=0,
            )
            for c, index in zip(coefficients, indices, strict=True)
        )
        # Round-off of sums of up to 60 terms.
        assert np.allclose(ChebyshevSum(indices, coefficients)(points), expected, atol=1e-12)
        assert np.allclose(design_matrix(points, indices) @ coefficients, expected, atol=1e-12)

    def test_indices(self):
        allowed = [
            k
            for k in itertools.product(range(4), range(3), range(7))
            if k[0] / 3 + k[1] / 2 + k[2] / 6 <= 1 + 1e-9
        ]
        assert index_tuples((3, 2, 6)).tolist() == [list(k) for k in allowed]


def random_keys(count, seed=5):
    random = np.random.default_rng(seed)
    return {key: random.uniform(part["from"], part["to"], count) for key, part in RANGES.items()}


class TestSurrogate:
    def test_hertz(self, tmp_path):
        """Two groups remain of four keys; the logarithm of the force is analytic in them."""
        surrogate = fit_surrogate(study_with_table(tmp_path, hertz), tmp_path, "force", 1e-6)
        assert len(surrogate.coordinates) == 2
        keys = random_keys(1000)
        assert np.abs(surrogate(keys) / hertz(keys) - 1).max() < 1e-6

    def test_groups_are_combined(self, tmp_path):
        """The ratio of contact radius to thickness, a power 1/2 of two lengths, is found.

        The factor is a function of it alone, and the error 3e-10. Of the groups h/R and delta/R a
        polynomial with as many terms has an error of 3e-5.
        """

        def on_a_layer(keys):
            a = np.sqrt(keys["indenter.R"] * keys["loading.delta"])
            return hertz(keys) * (1 + a / keys["body.height"]) ** 3

        layer = SCENE | {"body": {"shape": "layer", "height": 1.0}}
        heights = {"body.height": {"from": 0.1, "to": 10, "spacing": "log"}}
        changes = {"base": layer, "vary": RANGES | heights}
        study = study_with_table(tmp_path, on_a_layer, 800, **changes)
        surrogate = fit_surrogate(study, tmp_path, "force", 1e-6)
        half = {"body.height": 1.0, "indenter.R": -0.5, "loading.delta": -0.5}
        powers = [coordinate.powers for coordinate in surrogate.coordinates]
        assert any(
            sorted(found) == sorted(half)
            and all(found[key] / found["body.height"] == half[key] for key in half)
            for found in powers
        )

    def test_scale_is_exact(self, tmp_path):
        """Nothing limits a key that is a scale alone; the other keys keep their range."""
        surrogate = fit_surrogate(study_with_table(tmp_path, hertz), tmp_path, "force")
        keys = random_keys(50)
        stiffer = keys | {"material.E": 1e6 * keys["material.E"]}
        # Round-off.
        assert np.allclose(surrogate(stiffer), 1e6 * surrogate(keys), rtol=1e-12)
        larger = keys | {name: 1e3 * keys[name] for name in ("indenter.R", "loading.delta")}
        assert np.allclose(surrogate(larger), 1e6 * surrogate(keys), rtol=1e-12)
        with pytest.raises(UsageError, match="outside the range"):
            surrogate(keys | {"material.nu": 0.05})
        with pytest.raises(UsageError, match="50 of 50 points are outside"):
            surrogate(keys | {"loading.delta": 1e-4 * keys["indenter.R"]})

    def test_inside_tells_for_each_point(self, tmp_path):
        surrogate = fit_surrogate(study_with_table(tmp_path, hertz), tmp_path, "force")
        keys = random_keys(3) | {"material.nu": np.array([0.05, 0.3, np.nan])}
        assert surrogate.inside(keys).tolist() == [False, True, False]

    def test_the_stated_error_covers(self, tmp_path):
        """A kink has no accurate polynomial: 99 % of new points are within the stated error.

        With 4000 points the share is known to 0.2 %.
        """

        def kinked(keys):
            return hertz(keys) * (1 + 0.1 * np.abs(keys["material.nu"] - 0.3))

        study = study_with_table(tmp_path, kinked, 2000)
        surrogate = fit_surrogate(study, tmp_path, "force")
        assert surrogate.error["quantile"] == 0.99
        keys = random_keys(4000)
        errors = np.abs(surrogate(keys) / kinked(keys) - 1)
        assert 1e-4 < surrogate.error["error"] < 1e-2
        assert np.mean(errors <= surrogate.error["error"]) > 0.988
        with pytest.raises(VerificationError, match="not within 1e-06"):
            fit_surrogate(study, tmp_path, "force", 1e-6)

    def test_the_error_at_the_edges_is_stated(self, tmp_path):
        """A force that is nearly singular at an edge, nu = 0.5, where the sample has no runs.

        The stated difference is that of fits with fewer runs, which may be much larger than the
        error: it tells that the force there is unknown. A smooth force is accurate at the edges.
        """

        def steep(keys):
            return hertz(keys) / (0.501 - keys["material.nu"]) ** 0.5

        surrogate = fit_surrogate(study_with_table(tmp_path, steep), tmp_path, "force")
        keys = random_keys(500) | {"material.nu": 0.5}
        error = np.abs(surrogate(keys) / steep(keys) - 1).max()
        edges = surrogate.error["edges"]
        assert error > 3 * surrogate.error["error"]
        assert edges["difference"] > error / 5
        assert edges["at"]["material.nu"] == 0.5
        assert surrogate.error["largest_at"]["material.nu"] > 0.49
        smooth = fit_surrogate(study_with_table(tmp_path, hertz), tmp_path, "force")
        assert smooth.error["edges"]["difference"] < 1e-6

    def test_conditions_hold_for_its_points(self, tmp_path):
        study = study_with_table(tmp_path, hertz, where="loading.delta < indenter.R / 30")
        surrogate = fit_surrogate(study, tmp_path, "force")
        keys = random_keys(200)
        expected = keys["loading.delta"] < keys["indenter.R"] / 30
        assert surrogate.inside(keys).tolist() == expected.tolist()

    def test_numbers_and_shapes(self, tmp_path):
        surrogate = fit_surrogate(study_with_table(tmp_path, hertz), tmp_path, "force")
        keys = {"material.E": 2.0, "material.nu": 0.3, "indenter.R": 1.0}
        assert surrogate(keys | {"loading.delta": 0.02}).shape == ()
        assert surrogate(keys | {"loading.delta": np.full((2, 3), 0.02)}).shape == (2, 3)
        for wrong in ({"loading.depth": 1}, {}, {"loading.delta": [1, 2], "material.E": [1, 2, 3]}):
            with pytest.raises(UsageError):
                surrogate({"material.nu": 0.3, "indenter.R": 1.0} | wrong)

    def test_its_file(self, tmp_path):
        surrogate = fit_surrogate(study_with_table(tmp_path, hertz), tmp_path, "force")
        path = tmp_path / "surrogate.json"
        write_surrogate(surrogate, path)
        keys = random_keys(100)
        assert np.array_equal(read_surrogate(path)(keys), surrogate(keys))
        assert path.stat().st_size < 1e5

    def test_damaged_files_are_refused(self, tmp_path):
        path = tmp_path / "surrogate.json"
        write_surrogate(fit_surrogate(study_with_table(tmp_path, hertz), tmp_path, "force"), path)
        data = json.loads(path.read_text())
        changes = [
            {"kind": "fit"},
            {"indices": [[10**9, 0]], "coefficients": [1.0]},
            {"indices": data["indices"][::-1]},
            {"coefficients": data["coefficients"][:-1]},
            {"coefficients": [None] * len(data["coefficients"])},
            {"ranges": {}},
            {"ranges": {"material.nu": [1]}},
            {"where": ["__import__('os')"]},
            {"error": {}},
            {"coordinates": []},
            {"coordinates": [part | {"stretch": 1.0} for part in data["coordinates"]]},
            {"coordinates": [{"powers": {"material.nu": 1}, "log": False}]},
            {"coordinates": [{"powers": {"x": 1}, "log": True}] * 2},
        ]
        for change in changes:
            path.write_text(json.dumps(data | change))
            with pytest.raises(UsageError, match="not a readable surrogate"):
                read_surrogate(path)
        for text in ("", "[]", "{}", "[" * 100000):
            path.write_text(text)
            with pytest.raises(UsageError, match="not a readable surrogate"):
                read_surrogate(path)

    def test_a_table_of_another_study_is_refused(self, tmp_path):
        """A changed scene or range would give a surrogate of another scene, or too wide a range."""
        study_with_table(tmp_path, hertz)
        stiffer = SCENE | {"body": {"shape": "layer", "height": 50.0}}
        wider = RANGES | {"loading.delta": {"from": 0.01, "to": 0.1}}
        for change in ({"base": stiffer}, {"vary": wider}, {"sample": {"count": 400, "seed": 1}}):
            settings = {"base": SCENE, "vary": RANGES, "sample": {"count": 400}}
            other = studies.read(settings | {"output": {"runs": "none"}} | change)
            with pytest.raises(UsageError, match="is not the table of this study"):
                fit_surrogate(other, tmp_path, "force")

    def test_too_few_runs(self, tmp_path):
        with pytest.raises(UsageError, match="a surrogate needs 40"):
            fit_surrogate(study_with_table(tmp_path, hertz, 20), tmp_path, "force")
        with pytest.raises(UsageError, match="run the study first"):
            fit_surrogate(study_with_table(tmp_path, hertz), tmp_path / "none", "force")
