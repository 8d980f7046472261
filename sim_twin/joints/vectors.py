"""Vectors in space, and the sine and cosine of an angle, for kernels: floats that stay in registers."""

from __future__ import annotations

from math import floor, sqrt

from sim_twin.compiled import inlined, written_twice
from sim_twin.vector import Vector as Eight
from sim_twin.vector import fused_less, where_positive

Vector = tuple[float, float, float]
Rotation = tuple[Vector, Vector, Vector]
"""A rotation matrix by its rows: components in the outer frame from components in the body's."""
_EIGHTH = 0.78
_S3, _S5, _S7 = -1 / 6, 1 / 120, -1 / 5040
_S9, _S11, _S13 = 1 / 362880, -1 / 39916800, 1 / 6227020800
_S15, _C16 = -1 / 1307674368000, 1 / 20922789888000
_C4, _C6, _C8 = 1 / 24, -1 / 720, 1 / 40320
_C10, _C12, _C14 = -1 / 3628800, 1 / 479001600, -1 / 87178291200


@inlined
def added(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def subtracted(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def scaled(s: float, a: Vector) -> Vector:
    """s a."""
    return s * a[0], s * a[1], s * a[2]


@inlined
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def norm(a: Vector) -> float:
    """Length of a."""
    return sqrt(dot(a, a))


@inlined
def outward(R: Rotation, a: Vector) -> Vector:
    """R a: from the body's frame to the outer one."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


@inlined
def inward(R: Rotation, a: Vector) -> Vector:
    """R^T a: from the outer frame to the body's."""
    return (
        R[0][0] * a[0] + R[1][0] * a[1] + R[2][0] * a[2],
        R[0][1] * a[0] + R[1][1] * a[1] + R[2][1] * a[2],
        R[0][2] * a[0] + R[1][2] * a[1] + R[2][2] * a[2],
    )


@inlined
def column(R: Rotation, j: int) -> Vector:
    """Axis j of the body in the outer frame."""
    return R[0][j], R[1][j], R[2][j]


@inlined
def product(A: Rotation, B: Rotation) -> Rotation:
    """A B."""
    a, b, c = column(B, 0), column(B, 1), column(B, 2)
    return (
        (dot(A[0], a), dot(A[0], b), dot(A[0], c)),
        (dot(A[1], a), dot(A[1], b), dot(A[1], c)),
        (dot(A[2], a), dot(A[2], b), dot(A[2], c)),
    )


@inlined
def gibbs_rotation(g: Vector) -> Rotation:
    """Rotation by the angle 2 atan |g| about g (Rodrigues parameters: exact, without trigonometry)."""
    x, y, z = g
    s = 1.0 / (1.0 + x * x + y * y + z * z)
    t = 2.0 * s
    d = t - 1.0
    return (
        (d + t * x * x, t * (x * y - z), t * (x * z + y)),
        (t * (y * x + z), d + t * y * y, t * (y * z - x)),
        (t * (z * x - y), t * (z * y + x), d + t * z * z),
    )


@inlined
def gibbs_rate(g: Vector, omega: Vector) -> Vector:
    """Time derivative of g at the angular velocity `omega` (components in the body's frame, rad/s)."""
    turned = cross(g, omega)
    along = dot(g, omega)
    return (
        0.5 * (omega[0] + turned[0] + g[0] * along),
        0.5 * (omega[1] + turned[1] + g[1] * along),
        0.5 * (omega[2] + turned[2] + g[2] * along),
    )


# pi/2 in two parts, the first with so few bits that products with small integers are exact (Cody and Waite).
_RIGHT_ANGLE, _REST, _TURNS = 1.5707963267341256, 6.077100506506192e-11, 0.6366197723675814


@inlined
def _series(x: float) -> tuple[float, float]:
    z = x * x
    z2, z4 = z * z, z * z * z * z
    s = (_S3 + z * _S5) + z2 * (_S7 + z * _S9) + z4 * ((_S11 + z * _S13) + z2 * _S15)
    c = (_C4 + z * _C6) + z2 * (_C8 + z * _C10) + z4 * ((_C12 + z * _C14) + z2 * _C16)
    return x + x * z * s, 1.0 - 0.5 * z + z2 * c


@inlined
def _reduced(angle: float, quarter: float) -> float:
    # Fused, for fast arithmetic would add the two parts up first.
    return float(fused_less(quarter, _REST, fused_less(quarter, _RIGHT_ANGLE, angle)))


def _sine_cosine(angle: float) -> tuple[float, float]:
    if abs(angle) < _EIGHTH:
        return _series(angle)
    quarter = floor(angle * _TURNS + 0.5)
    s, c = _series(_reduced(angle, quarter))
    quadrant = int(quarter)
    sine, cosine = (c, s) if (quadrant & 1) != 0 else (s, c)
    sine = -sine if (quadrant & 2) != 0 else sine
    cosine = -cosine if ((quadrant + 1) & 2) != 0 else cosine
    return sine, cosine


def _sines_cosines(angle: Eight) -> tuple[Eight, Eight]:
    quarter = floor(angle * _TURNS + 0.5)
    s, c = _series(_reduced(angle, quarter))
    quadrant = quarter - 4.0 * floor(0.25 * quarter)
    swapped = 0.5 - abs(abs(quadrant - 2.0) - 1.0)  # 1 and 3
    sine, cosine = where_positive(swapped, c, s), where_positive(swapped, s, c)
    sine = where_positive(quadrant - 1.5, -sine, sine)
    return sine, where_positive(1.0 - abs(quadrant - 1.5), -cosine, cosine)


sine_cosine = written_twice(_sine_cosine, _sines_cosines)
"""Sine and cosine of an angle in rad, to 5e-16 up to 1e5 rad (Taylor's series, reduced range)."""
