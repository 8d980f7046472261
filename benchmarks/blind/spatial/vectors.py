"""Vectors, turnings and small equations, compiled; numba looks for changes in a kernel's own file only."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import ParamSpec, TypeAlias, TypeVar, cast

from numba import njit

from benchmarks.blind.finite_elements import Array

P = ParamSpec("P")
R = TypeVar("R")
Vector: TypeAlias = tuple[float, float, float]
Matrix: TypeAlias = tuple[Vector, Vector, Vector]


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """numba's compilation, typed."""
    return cast("Callable[P, R]", njit(cache=True, error_model="numpy")(function))


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def times(factor: float, a: Vector) -> Vector:
    return factor * a[0], factor * a[1], factor * a[2]


@compiled
def three(y: Array, at: int) -> Vector:
    return y[at], y[at + 1], y[at + 2]


@compiled
def rotation(y: Array, at: int) -> Matrix:
    """The matrix of the quaternion at `at`, from the body's axes to the world's."""
    a, b, c, d = y[at], y[at + 1], y[at + 2], y[at + 3]
    return (
        (a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)),
        (2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)),
        (2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d),
    )


@compiled
def to_world(R: Matrix, a: Vector) -> Vector:
    """R a."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


@compiled
def to_body(R: Matrix, a: Vector) -> Vector:
    """The transpose of R times a."""
    return plus(plus(times(a[0], R[0]), times(a[1], R[1])), times(a[2], R[2]))


@compiled
def solve_lower(M: Array, count: int, sides: Array) -> None:
    """Cholesky of `M` in place; the first `count` rows of `sides` become L^-1 of themselves."""
    for j in range(6):
        for i in range(j, 6):
            total = M[i, j]
            for k in range(j):
                total -= M[i, k] * M[j, k]
            M[i, j] = sqrt(total) if i == j else total / M[j, j]
    for row in range(count):
        for i in range(6):
            total = sides[row, i]
            for k in range(i):
                total -= M[i, k] * sides[row, k]
            sides[row, i] = total / M[i, i]


@compiled
def solve_joint(W: Array) -> None:
    """Solve the joint's four equations W (4, 5), symmetric and definite; the last column is the answer."""
    for j in range(4):
        for i in range(j + 1, 4):
            factor = W[i, j] / W[j, j]
            for k in range(j, 5):
                W[i, k] -= factor * W[j, k]
    for i in range(3, -1, -1):
        total = W[i, 4]
        for k in range(i + 1, 4):
            total -= W[i, k] * W[k, 4]
        W[i, 4] = total / W[i, i]
