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


def log(x: Any) -> Any:
    """Natural logarithm."""
    if is_symbolic(x):
        import ufl

        return ufl.ln(x)
    import numpy as np

    return np.log(x)


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


# A principal stretch has no derivative where two of them meet, yet a function symmetric in the stretches has. It keeps
# its first three terms there when the root and the arc cosine stay away from their singular points by this much; the
# energy changes by the order of SPLIT times the cube of the strain deviator, cancellation is below 1e-9.
SPLIT = 1e-6


def principal_stretches(F: Any) -> list[Any]:
    """The three principal stretches of a deformation gradient (3x3, UFL), by Cardano's formula for F^T F."""
    import ufl

    C = F.T * F
    mean = ufl.tr(C) / 3
    deviator = C - mean * ufl.Identity(3)
    size = ufl.sqrt(ufl.inner(deviator, deviator) / 6 + SPLIT**2)
    cosine = ufl.det(deviator) / (2 * size**3)
    angle = ufl.acos(cosine * (1 - SPLIT)) / 3
    return [ufl.sqrt(mean + 2 * size * ufl.cos(angle + 2 * pi * k / 3)) for k in range(3)]
