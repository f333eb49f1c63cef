"""indent-sim: rigid, analytic indenters pressed into elastic bodies, with a known error on every number."""

from __future__ import annotations

__version__ = "0.1.0"
