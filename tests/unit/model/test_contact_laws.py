"""Properties of contact laws."""

from __future__ import annotations

import pytest

from indent_sim.model.adhesion import Adhesion
from indent_sim.model.contact import AugmentedLagrangian, AutoContact, ContactLaw, Nitsche, Penalty

ADHESION = Adhesion(work=0.1, range=0.01)
ROUGH, STUCK = AugmentedLagrangian(friction=0.3), AugmentedLagrangian(friction="stick")


@pytest.mark.parametrize("law", [AugmentedLagrangian(), Penalty(), AutoContact(), Nitsche()])
def test_a_smooth_tip_stands_against_nothing(law: ContactLaw) -> None:
    assert law.is_conservative and not (law.is_path_dependent or law.may_slip or law.is_bonded)
    assert (
        law.path_key
        == law.feature_without_theory
        == law.reason_no_elastic_curve
        == law.reason_unsymmetric
        == ""
        and law.remedies == ()
    )


@pytest.mark.parametrize("law", [ROUGH, STUCK, AutoContact(friction=0.3)])
def test_friction_is_named(law: ContactLaw) -> None:
    assert law.is_path_dependent and law.path_key == law.feature_without_theory == "friction"
    assert law.reason_no_elastic_curve and law.reason_unsymmetric.startswith("friction")


def test_what_slips_is_not_bonded() -> None:
    assert ROUGH.may_slip and not ROUGH.is_bonded and STUCK.is_bonded and not STUCK.may_slip


def test_adhesion_is_named() -> None:
    law = AugmentedLagrangian(adhesion=ADHESION)
    assert law.is_path_dependent and law.is_conservative and law.path_key == "adhesion"
    assert (
        law.feature_without_theory == "adhesion with a range"
        and law.reason_unsymmetric.startswith("adhesion")
    )


def test_a_condensed_body_has_no_penalty_that_rubs() -> None:
    assert (
        Penalty().reason_not_condensable == ""
        and "penalty" in Penalty(friction=0.3).reason_not_condensable
    )
    assert (
        ROUGH.reason_not_condensable == ""
        and "adhesion" in AugmentedLagrangian(adhesion=ADHESION).reason_not_condensable
    )


def test_what_may_help_where_no_equilibrium_is_found() -> None:
    given = AugmentedLagrangian(epsilon_n=1.0, epsilon_t=1.0, friction="stick")
    assert given.remedies == ("contact.friction: 5",)
    steered = AugmentedLagrangian(epsilon_n=1.0, epsilon_t=2.0, friction=0.3)
    assert steered.remedies == ("contact.epsilon_t: auto",)
