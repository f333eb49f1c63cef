"""The few functions a tip's formula needs, working alike on UFL expressions and on numpy arrays.

A tip is written once; the solver differentiates it symbolically and the results evaluate it in numpy.
"""

from __future__ import annotations

from math import pi
from typing import Any


def is_symbolic(*values: Any) -> bool:
    """Whether any of the values is a UFL expression."""
    return any(hasattr(value, "ufl_shape") for value in values)


def sqrt(x: Any) -> Any:
    """Square root."""
    if is_symbolic(x):
        import ufl

        return ufl.sqrt(x)
    import numpy as np

    return np.sqrt(x)


def where_less(a: Any, b: Any, then: Any, otherwise: Any) -> Any:
    """`then` where a < b, else `otherwise`; both branches are evaluated, so both must be finite."""
    if is_symbolic(a, b, then, otherwise):
        import ufl

        return ufl.conditional(ufl.lt(a, b), then, otherwise)
    import numpy as np

    return np.where(np.less(a, b), then, otherwise)


def minimum(a: Any, b: Any) -> Any:
    """The smaller of the two."""
    return where_less(a, b, a, b)


def maximum(a: Any, b: Any) -> Any:
    """The larger of the two."""
    return where_less(a, b, b, a)


def macaulay(x: Any) -> Any:
    """The Macaulay bracket <x> = (x + |x|)/2 (notes eq. 3.2)."""
    return where_less(0.0, x, x, 0.0 * x)


def sin(degrees: Any) -> Any:
    """Sine of an angle in degrees."""
    return _of_angle("sin", degrees)


def cos(degrees: Any) -> Any:
    """Cosine of an angle in degrees."""
    return _of_angle("cos", degrees)


def tan(degrees: Any) -> Any:
    """Tangent of an angle in degrees."""
    return _of_angle("tan", degrees)


def _of_angle(name: str, degrees: Any) -> Any:
    if is_symbolic(degrees):
        import ufl

        return getattr(ufl, name)(degrees * pi / 180)
    import numpy as np

    return getattr(np, name)(np.radians(degrees))
