"""Sine and cosine of an angle at once, for kernels."""

from __future__ import annotations

from math import floor

from sim_twin.compiled import inlined

# pi/2 in two parts, the first with so few bits that products with small integers are exact (Cody and Waite).
_RIGHT_ANGLE, _REST, _TURNS = 1.5707963267341256, 6.077100506506192e-11, 0.6366197723675814
_EIGHTH = 0.78
_S3, _S5, _S7 = -1 / 6, 1 / 120, -1 / 5040
_S9, _S11, _S13 = 1 / 362880, -1 / 39916800, 1 / 6227020800
_S15, _C16 = -1 / 1307674368000, 1 / 20922789888000
_C4, _C6, _C8 = 1 / 24, -1 / 720, 1 / 40320
_C10, _C12, _C14 = -1 / 3628800, 1 / 479001600, -1 / 87178291200


@inlined
def _series(x: float) -> tuple[float, float]:
    z = x * x
    z2, z4 = z * z, z * z * z * z
    s = (_S3 + z * _S5) + z2 * (_S7 + z * _S9) + z4 * ((_S11 + z * _S13) + z2 * _S15)
    c = (_C4 + z * _C6) + z2 * (_C8 + z * _C10) + z4 * ((_C12 + z * _C14) + z2 * _C16)
    return x + x * z * s, 1.0 - 0.5 * z + z2 * c


@inlined
def sine_cosine(angle: float) -> tuple[float, float]:
    """Sine and cosine of `angle` rad, to 5e-16 up to 1e5 rad (Taylor's series, reduced range)."""
    if abs(angle) < _EIGHTH:
        return _series(angle)
    quarter = floor(angle * _TURNS + 0.5)
    s, c = _series((angle - quarter * _RIGHT_ANGLE) - quarter * _REST)
    quadrant = int(quarter)
    sine, cosine = (c, s) if (quadrant & 1) != 0 else (s, c)
    sine = -sine if (quadrant & 2) != 0 else sine
    cosine = -cosine if ((quadrant + 1) & 2) != 0 else cosine
    return sine, cosine
