"""Scenes solved beside one: what they tell of its force."""
