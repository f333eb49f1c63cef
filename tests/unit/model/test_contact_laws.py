"""What contact laws say of themselves."""

from __future__ import annotations

import pytest

from indent_sim.model.contact import (
    Adhesion,
    AugmentedLagrangian,
    AutoContact,
    ContactLaw,
    Nitsche,
    Penalty,
)

ADHESION = Adhesion(work=0.1, range=0.01)
ROUGH, STUCK = AugmentedLagrangian(friction=0.3), AugmentedLagrangian(friction="stick")


@pytest.mark.parametrize("law", [AugmentedLagrangian(), Penalty(), AutoContact(), Nitsche()])
def test_a_smooth_tip_stands_against_nothing(law: ContactLaw) -> None:
    assert law.is_conservative and not (law.has_memory or law.slips or law.is_bonded)
    assert (
        law.path_key == law.beyond_theory == law.beyond_curve == law.unsymmetric == ""
        and law.remedies == ()
    )


@pytest.mark.parametrize("law", [ROUGH, STUCK, AutoContact(friction=0.3)])
def test_friction_is_named(law: ContactLaw) -> None:
    assert law.has_memory and law.path_key == law.beyond_theory == "friction"
    assert law.beyond_curve and law.unsymmetric.startswith("friction")


def test_what_slips_is_not_bonded() -> None:
    assert ROUGH.slips and not ROUGH.is_bonded and STUCK.is_bonded and not STUCK.slips


def test_adhesion_is_named() -> None:
    law = AugmentedLagrangian(adhesion=ADHESION)
    assert law.has_memory and law.is_conservative and law.path_key == "adhesion"
    assert law.beyond_theory == "attraction with a range" and law.unsymmetric.startswith("adhesion")


def test_a_condensed_body_has_no_penalty_that_rubs() -> None:
    assert Penalty().uncondensed == "" and "penalty" in Penalty(friction=0.3).uncondensed
    assert (
        ROUGH.uncondensed == "" and "adheres" in AugmentedLagrangian(adhesion=ADHESION).uncondensed
    )


def test_what_may_help_where_no_equilibrium_is_found() -> None:
    given = AugmentedLagrangian(epsilon_n=1.0, epsilon_t=1.0, friction="stick")
    assert given.remedies == ("contact.friction: 5",)
    steered = AugmentedLagrangian(epsilon_n=1.0, epsilon_t=2.0, friction=0.3)
    assert steered.remedies == ("contact.epsilon_t: auto",)
