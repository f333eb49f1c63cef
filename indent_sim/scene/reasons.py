"""Selection of the reason that is reported for a choice of the program."""

from __future__ import annotations


def first_reason(*reasons: tuple[bool, str]) -> str:
    """Return the first reason whose condition is true; empty if no condition is true."""
    return next((why for applies, why in reasons if applies), "")
