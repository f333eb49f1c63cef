"""The terms of the tip: its pressure by every contact method, and its friction."""
