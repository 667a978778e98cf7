"""
A small strictly convex quadratic program with inequalities, exactly, in a bounded number of steps.

Dual active set method: Goldfarb and Idnani, A numerically stable dual method for solving strictly
convex quadratic programs, Mathematical Programming 27, 1983.
"""
from __future__ import annotations

import math

from gdmp_ros.kernels import kernel, local_numbers, local_zeros, noinline, vector_at
from gdmp_ros.manifolds.linalg import cholesky, invert_lower

#: Steps after which the search ends: each adds a row to the active ones, or removes one.
MOST_STEPS = 60
#: Instead of a number of steps `solve` returns: too many, or that no point satisfies all rows.
TOO_LONG, INFEASIBLE = -1, -2
#: A row counts as satisfied that is violated by less, in the unit of its bound.
TOLERANCE = 1e-10


@kernel
def _project(inverse, row, n, out):
    """``out = Jᵀ row``; ``inverse`` is J, column by column."""
    for i in range(n):
        out[i] = 0.0
        for k in range(n):
            out[i] += inverse[n * i + k] * row[k]


@kernel
def _add(upper, inverse, projected, n, count):
    """
    Make a row, as `_project` gives it, the last active one.

    :returns: whether it does not depend on the others
    """
    for j in range(n - 1, count, -1):
        size = math.hypot(projected[j - 1], projected[j])
        if size == 0.0:
            continue
        c, s = projected[j - 1] / size, projected[j] / size
        projected[j - 1], projected[j] = size, 0.0
        for k in range(n):
            first, second = inverse[n * (j - 1) + k], inverse[n * j + k]
            inverse[n * (j - 1) + k] = c * first + s * second
            inverse[n * j + k] = c * second - s * first
    for i in range(count + 1):
        upper[n * i + count] = projected[i]
    return abs(projected[count]) > 1e-12


@kernel
def _remove(upper, inverse, active, dual, n, count, at):
    """Remove an active row, and keep the triangle."""
    for j in range(at, count - 1):
        active[j], dual[j] = active[j + 1], dual[j + 1]
        for i in range(n):
            upper[n * i + j] = upper[n * i + j + 1]
    dual[count - 1] = dual[count]
    for j in range(at, count - 1):
        size = math.hypot(upper[n * j + j], upper[n * (j + 1) + j])
        if size == 0.0:
            continue
        c, s = upper[n * j + j] / size, upper[n * (j + 1) + j] / size
        for k in range(j, count - 1):
            first, second = upper[n * j + k], upper[n * (j + 1) + k]
            upper[n * j + k] = c * first + s * second
            upper[n * (j + 1) + k] = c * second - s * first
        for k in range(n):
            first, second = inverse[n * j + k], inverse[n * (j + 1) + k]
            inverse[n * j + k] = c * first + s * second
            inverse[n * (j + 1) + k] = c * second - s * first


@kernel
def _most_violated(rows, bounds, x, active, count):
    """The row that is violated most, and by how much; -1 if none is."""
    worst, most = -1, TOLERANCE
    for i in range(bounds.size):
        excess = -bounds[i]
        for k in range(x.size):
            excess += rows[i, k] * x[k]
        if excess > most:
            known = False
            for j in range(count):
                known = known or active[j] == i
            if not known:
                worst, most = i, excess
    return worst, most


@kernel
def solve(hessian, gradient, rows, bounds, x, multipliers):
    """
    Minimise ``½ xᵀ H x − gᵀ x`` subject to ``A x ≤ b``.

    :param hessian: H, positive definite, shape (n, n)
    :param gradient: g, shape (n,)
    :param rows: A, shape (m, n)
    :param bounds: b, shape (m,)
    :param x: written, shape (n,)
    :param multipliers: written, one for each row, ≥ 0, shape (m,)
    :returns: number of steps, or `TOO_LONG` or `INFEASIBLE`: then x does not satisfy all rows
    """
    noinline()
    n = gradient.size
    lower, root = local_numbers(n * n), local_numbers(n * n)
    inverse, upper = local_numbers(n * n), local_zeros(n * n)
    projected, step, change = local_numbers(n), local_numbers(n), local_numbers(n)
    active, dual = local_zeros(n + 1), local_zeros(n + 1)
    multipliers[:] = 0.0
    cholesky(n, vector_at(hessian, 0, n * n), lower)
    invert_lower(n, lower, root)
    # J = L⁻ᵀ, kept column by column: its columns are the rows of L⁻¹.
    for i in range(n):
        for k in range(n):
            inverse[n * i + k] = root[n * i + k] if k <= i else 0.0
    _project(inverse, gradient, n, projected)
    for k in range(n):
        x[k] = 0.0
        for i in range(n):
            x[k] += inverse[n * i + k] * projected[i]
    count, worst, excess = 0, -1, 0.0
    for done in range(MOST_STEPS):
        if worst < 0:
            worst, excess = _most_violated(rows, bounds, x, active, count)
            if worst < 0:
                for j in range(count):
                    multipliers[int(active[j])] = dual[j]
                return done
            dual[count] = 0.0
        _project(inverse, rows[worst], n, projected)
        # Direction of x, and of the multipliers of the active rows.
        length = 0.0
        for i in range(count, n):
            length += projected[i] * projected[i]
        for k in range(n):
            step[k] = 0.0
            for i in range(count, n):
                step[k] += inverse[n * i + k] * projected[i]
        for i in range(count - 1, -1, -1):
            change[i] = projected[i]
            for j in range(i + 1, count):
                change[i] -= upper[n * i + j] * change[j]
            change[i] /= upper[n * i + i]
        # Largest step with which no multiplier becomes negative.
        blocks, shortest = -1, math.inf
        for j in range(count):
            if change[j] > 0.0 and dual[j] < shortest * change[j]:
                blocks, shortest = j, dual[j] / change[j]
        whole = excess / length if length > 1e-14 else math.inf
        amount = min(whole, shortest)
        if amount == math.inf:
            return INFEASIBLE
        for j in range(count):
            dual[j] -= amount * change[j]
        dual[count] += amount
        if whole < math.inf:
            for k in range(n):
                x[k] -= amount * step[k]
            excess -= amount * length
        if whole <= shortest:
            active[count] = worst
            if not _add(upper, inverse, projected, n, count):
                return INFEASIBLE
            count, worst = count + 1, -1
        else:
            _remove(upper, inverse, active, dual, n, count, blocks)
            count -= 1
    return TOO_LONG
