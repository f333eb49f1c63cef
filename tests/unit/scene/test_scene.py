"""From Config to Scene: refusals, warnings, and choices with their reasons."""

from __future__ import annotations

from typing import Any, ClassVar

import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import Scene, resolve

BODIES: dict[str, dict[str, Any]] = {
    "axisymmetric": {"shape": "cylinder", "radius": 2.0, "height": 2.0},
    "plane_strain": {"shape": "strip", "width": 4.0, "height": 2.0},
    "three_dimensional": {"shape": "box", "size": [4.0, 4.0, 2.0]},
}


def scene(kinematics: str = "axisymmetric", **sections: Any) -> Scene:
    """A paraboloid of radius 2 pressed in by 0.02; `sections` replace whole sections."""
    given: dict[str, Any] = {
        "body": BODIES[kinematics],
        "material": {"model": "linear_elastic", "E": 5.0, "nu": 0.3},
        "indenter": {"shape": "paraboloid", "R": 2.0},
        "loading": {"delta": 0.02, "steps": 1},
    }
    return resolve(config_from_mapping(given | sections))


class TestNitsche:
    unit = 5.0 / (1 - 0.3**2) / 0.02  # E*/h_contact

    def with_gamma(self, gamma: Any) -> Scene:
        return scene(contact={"method": "nitsche", "gamma": gamma}, mesh={"h_contact": 0.02})

    def test_too_soft_is_refused_and_what_is_needed_is_said(self):
        with pytest.raises(ConfigError) as caught:
            self.with_gamma(0.1 * self.unit)
        assert caught.value.key == "contact.gamma" and caught.value.exit_code == 3
        assert "0.1 E*/h_contact" in str(caught.value) and f"at least {self.unit:.4g}" in str(
            caught.value
        )

    @pytest.mark.parametrize("gamma", ["auto", unit, 30 * unit])
    def test_enough_is_taken(self, gamma):
        wanted = 10 * self.unit if gamma == "auto" else gamma
        assert self.with_gamma(gamma).physics.contact.stiffness == pytest.approx(wanted * 2.0 / 5.0)


LOCKED = {"model": "linear_elastic", "E": 5.0, "nu": 0.4999, "formulation": "displacement"}


class TestLinear:
    solid: ClassVar[dict[str, Any]] = {
        "kinematics": "three_dimensional",
        "mesh": {"h_contact": 0.1},
    }

    @pytest.mark.parametrize(
        ("sections", "why"),
        [
            ({"kinematics": "axisymmetric"}, "axisymmetric and plane"),
            ({"kinematics": "plane_strain"}, "axisymmetric and plane"),
            (solid | {"contact": {"method": "nitsche"}}, "not symmetric"),
            (solid | {"contact": {"method": "active_set"}}, "not symmetric"),
            (solid | {"material": LOCKED}, r"displacement elements at nu = 0\.4999"),
            (
                solid | {"contact": {"method": "augmented_lagrangian", "epsilon_n": 5e7}},
                r"E\*/h_contact needs",
            ),
        ],
    )
    def test_iterative_is_refused_by_name_where_it_is_not_known_to_work(self, sections, why):
        with pytest.raises(ConfigError, match=why) as caught:
            scene(**sections, solver={"linear": "iterative"})
        assert caught.value.key == "solver.linear" and caught.value.exit_code == 3
        assert scene(**sections).solver.linear == "direct"

    def test_a_condensed_body_is_factored(self):
        with pytest.raises(ConfigError, match="whole body") as caught:
            scene(**self.solid, solver={"linear": "iterative", "method": "condensed"})
        assert caught.value.key == "solver.method"

    def test_theory_has_no_linear_systems_whatever_is_said_of_a_mesh(self):
        with pytest.raises(ConfigError, match=r"solver\.linear, solver\.rtol"):
            scene(mesh={"h_contact": 0.1}, solver={"linear": "iterative", "method": "theory"})

    def test_auto_factors_what_is_small_and_iterates_where_that_is_cheaper(self):
        small, large = (
            scene("three_dimensional", mesh={"h_contact": h, "h_far": 10 * h}) for h in (0.1, 0.012)
        )
        assert (small.solver.method, small.solver.linear) == ("condensed", "direct")
        assert (large.solver.method, large.solver.linear) == ("newton", "iterative")
        assert "iterative" in next(
            choice.why for choice in large.plan.choices if choice.key == "solver.linear"
        )

    def test_what_does_not_fit_is_told_what_would(self, monkeypatch):
        monkeypatch.setattr("indent_sim.scene.scene.machine_memory", lambda: 1e9)
        mesh = {"h_contact": 0.02, "h_far": 0.15}
        with pytest.raises(ConfigError, match=r"use solver\.linear: iterative"):
            scene("three_dimensional", mesh=mesh, solver={"linear": "direct"})
        assert scene("three_dimensional", mesh=mesh).solver.linear == "iterative"


class TestMesh:
    def said(self, kinematics: str, per_radius: float) -> str:
        a = scene(kinematics).plan.prediction["a"]
        mesh = {"h_contact": a / per_radius}
        return " ".join(scene(kinematics, mesh=mesh).plan.warnings)

    @pytest.mark.parametrize("kinematics", BODIES)
    @pytest.mark.parametrize(
        ("per_radius", "likely"),
        [(1.5, "about 3 %"), (0.5, "tens of per cent")],
    )
    def test_too_few_elements_in_the_contact(self, kinematics, per_radius, likely):
        said = self.said(kinematics, per_radius)
        assert f"only {per_radius:.2g} elements" in said and likely in said

    def test_enough_elements(self):
        assert "elements in the expected" not in self.said("axisymmetric", 3.2)

    def test_a_tip_that_never_touches_has_no_contact_to_resolve(self):
        out = scene(loading={"deltas": [-0.1]}, mesh={"h_contact": 0.5})
        assert len(out.plan.warnings) == 1


class TestStrain:
    """The limit of small strain, 0.05 of characteristic strain: a sphere at a = R/4.

    There its force differs by some per cent between the strain measures.
    """

    def said(
        self, delta: float = 0.02, material: str = "linear_elastic", gap: str = "auto", **tip: Any
    ) -> str:
        linear = {"model": material, "E": 5.0, "nu": 0.3}
        given = {"indenter": tip, "material": linear, "contact": {"method": "auto", "gap": gap}}
        return " ".join(scene(loading={"delta": delta, "steps": 1}, **given).plan.warnings)

    @pytest.mark.parametrize(
        ("sharp", "blunt"),
        [
            ({"shape": "cone", "half_angle": 75}, {"shape": "cone", "half_angle": 77}),
            ({"shape": "pyramid", "half_angle": 74}, {"shape": "pyramid", "half_angle": 76}),
            (
                {"shape": "profile", "points": [[0, 0], [1, 0.26]]},
                {"shape": "profile", "points": [[0, 0], [1, 0.24]]},
            ),
            ({"shape": "sphere", "R": 0.2}, {"shape": "sphere", "R": 0.5}),
            ({"shape": "flat_punch", "radius": 0.11}, {"shape": "flat_punch", "radius": 0.13}),
        ],
        ids=["cone", "pyramid", "profile", "sphere", "flat_punch"],
    )
    def test_small_strain_ends_with_the_slope_at_the_edge_of_contact(self, sharp, blunt):
        """Small strain is warned of beyond a slope of 0.25 = cot 76 degrees at the contact edge.

        Pyramids count a tenth flatter than their faces, and a punch at a sixth of its radius.
        """
        assert "small strain" in self.said(**sharp)
        assert "small strain" not in self.said(**blunt)
        assert "small strain" not in self.said(material="neo_hookean", **sharp)

    def test_a_cone_has_the_same_strain_at_every_depth(self):
        assert all(
            "= 0.073" in self.said(delta, shape="cone", half_angle=70) for delta in (1e-4, 1e-2)
        )

    @pytest.mark.parametrize("gap", ["reference", "current"])
    def test_a_tip_that_ends_inside_the_contact_says_so(self, gap):
        for tip in (
            {"shape": "sphere", "R": 0.1},
            {"shape": "profile", "points": [[0, 0], [0.1, 0.05]]},
        ):
            warning = "the contact reaches the end" if gap == "reference" else "the depth exceeds"
            assert warning not in self.said(0.01, gap=gap, **tip)
            assert warning in self.said(0.11, gap=gap, **tip)
            assert ("radius of the sphere" in self.said(0.11, gap=gap, **tip)) == (
                gap == "current" and "R" in tip
            )

    def test_several_equilibria_are_stated(self):
        method = {"method": "active_set", "gap": "current"}
        several = scene(contact=method, material={"model": "neo_hookean", "E": 5.0, "nu": 0.3})
        assert "several equilibria" in " ".join(several.plan.warnings)
        assert several.plan.prediction["force_error"] == pytest.approx(0.002)
        assert "force_error" not in scene(contact=method | {"gap": "reference"}).plan.prediction


@pytest.mark.parametrize("kinematics", BODIES)
def test_kinematics_and_strain_are_two_choices(kinematics):
    why = {choice.key: choice for choice in scene(kinematics).plan.choices}
    assert why["kinematics"].value == kinematics
    assert "small strain" not in why["kinematics"].why
    assert "finite strain" not in why["kinematics"].why
    assert why["strain"].value == "small" and "linear elastic" in why["strain"].why


def test_the_half_space_is_refused_without_a_percentage_of_its_own():
    said = " ".join(scene().plan.warnings)
    assert "the half-space formula Hertz does not apply" in said and "%" not in said


@pytest.mark.parametrize("width", [8.0, 7.974162139218347, 1.2345678912345, 0.70000000000123])
def test_the_middle_is_found_whatever_the_digits_of_the_width(width):
    """A tip in the middle gives a symmetric model for every number of digits of the width.

    Lengths are rounded to 12 digits, the tip's position and the middle each on its own.
    """
    strip = {"shape": "strip", "width": width, "height": 1.1, "sides": "roller"}
    box = {"shape": "box", "size": [width, width / 3, 1.1]}
    for body, symmetry in ((strip, "half"), (box, "quarter")):
        found = resolve(
            config_from_mapping(
                {
                    "body": body,
                    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
                    "indenter": {"shape": "paraboloid", "R": 1.0},
                    "loading": {"delta": 1e-3},
                }
            )
        )
        assert found.physics.domain.symmetry == symmetry and found.plan.theory is not None
        assert found.plan.theory.is_exact == (body is strip)


@pytest.mark.parametrize(
    "tip", [{"shape": "sphere", "R": 1e-6}, {"shape": "flat_punch", "radius": 1e-5}]
)
def test_elements_larger_than_a_tip_are_refused(tip):
    """Elements larger than the tip's radius are refused; automatic sizes resolve the tip.

    The force was up to sixty times too large.
    """
    with pytest.raises(ConfigError, match="are larger than the tip's radius"):
        scene(indenter=tip, loading={"delta": 0.01, "steps": 1}, mesh={"h_contact": 0.01})
    assert scene(indenter=tip, loading={"delta": 0.01, "steps": 1}, mesh={}).sizes.min_size < 1e-5


@pytest.mark.parametrize(
    ("tip", "where"),
    [
        ({"shape": "cone", "half_angle": 70}, "sharp apex"),
        (
            {"shape": "cone", "half_angle": 70, "tip_radius": 1e-4},
            "apex (rounded by less than an element)",
        ),
        ({"shape": "flat_punch", "radius": 0.1}, "sharp edge"),
        (
            {"shape": "flat_punch", "radius": 0.1, "edge_radius": 1e-5},
            "edge (rounded by less than an element)",
        ),
    ],
)
def test_a_pressure_without_a_peak_says_where(tip, where):
    (why,) = (
        choice.why
        for choice in scene(indenter=tip, mesh={"h_contact": 0.01}).plan.choices
        if choice.key == "p_max"
    )
    assert f"the tip's {where} depends on the mesh" in why


def test_layers_on_a_half_space_end_where_its_finite_body_does():
    """The last layer of a truncated half-space has the thickness that the films leave.

    1e-9 is the rounding of sizes.
    """
    matter = [{"model": "linear_elastic", "E": E, "nu": 0.3} for E in (3.0, 1.0)]
    body = {
        "shape": "half_space",
        "layers": [{"thickness": 0.1, "material": matter[0]}, {"material": matter[1]}],
    }
    given = {
        "body": body,
        "indenter": {"shape": "paraboloid", "R": 1.0},
        "loading": {"delta": 0.01, "steps": 1},
    }
    part = resolve(config_from_mapping(given | {"solver": {"method": "condensed"}})).physics.domain
    assert part.regions[-1].bottom == pytest.approx(-part.height, rel=1e-9)
