"""Reasons for a choice of the program, of which the first that applies is reported."""

from __future__ import annotations


def first_reason(*reasons: tuple[bool, str]) -> str:
    """The first of the reasons that apply; empty where none does."""
    return next((why for applies, why in reasons if applies), "")
