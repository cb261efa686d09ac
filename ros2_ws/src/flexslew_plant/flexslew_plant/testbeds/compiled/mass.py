"""Linear solves with a testbed's mass matrix, as kernels.

Where the modal block is diagonal the modes are eliminated first. One and two joints then have
closed forms; more joints, and a full mass matrix, are solved by Cholesky's decomposition.
"""

from flexslew_plant.arrays import Matrix, Vector, merged


@merged("a")
def cholesky(a: Matrix) -> None:
    """Replace the lower triangle of a, shape (n, n), by L of a = L L^T."""
    n = a.shape[0]
    for j in range(n):
        for k in range(j):
            a[j, j] -= a[j, k] * a[j, k]
        a[j, j] = a[j, j] ** 0.5
        for i in range(j + 1, n):
            for k in range(j):
                a[i, j] -= a[i, k] * a[j, k]
            a[i, j] /= a[j, j]


@merged("r")
def substitute(a: Matrix, r: Vector) -> None:
    """Replace the first n entries of r by (L L^T)^-1 r.

    Args:
        a: L in its lower triangle, shape (n, n).
        r: in and out, n entries or more.
    """
    n = a.shape[0]
    for i in range(n):
        for k in range(i):
            r[i] -= a[i, k] * r[k]
        r[i] /= a[i, i]
    for step in range(n):
        i = n - 1 - step
        for k in range(i + 1, n):
            r[i] -= a[k, i] * r[k]
        r[i] /= a[i, i]


@merged("joints", "coupling", "modal")
def factor(joints: Matrix, coupling: Matrix, modal: Vector) -> None:
    """Prepare the blocks of M for solve: nothing for one or two joints, else in place."""
    m, n = coupling.shape
    if m > 2:
        for j in range(n):
            for i in range(m):
                f = coupling[i, j] / modal[j]
                for k in range(i + 1):
                    joints[i, k] -= f * coupling[k, j]
        cholesky(joints)


@merged("r")
def solve(joints: Matrix, coupling: Matrix, modal: Vector, r: Vector) -> None:
    """Replace r by M^-1 r, eliminating the diagonal modal block first.

    Args:
        joints, coupling, modal: the blocks of M after `factor`.
        r: in and out, shape (n,).
    """
    m, n = coupling.shape
    if m > 2:
        for j in range(n):
            f = r[m + j] / modal[j]
            for i in range(m):
                r[i] -= coupling[i, j] * f
        substitute(joints, r)
        for j in range(n):
            for i in range(m):
                r[m + j] -= coupling[i, j] * r[i]
            r[m + j] /= modal[j]
        return
    if m == 0:  # every joint is held
        for j in range(n):
            r[j] /= modal[j]
        return
    a, b, d = joints[0, 0], 0.0, 1.0
    if m == 2:
        b, d = joints[0, 1], joints[1, 1]
    for j in range(n):
        f = coupling[0, j] / modal[j]
        a -= f * coupling[0, j]
        r[0] -= f * r[m + j]
        if m == 2:
            g = coupling[1, j] / modal[j]
            b -= f * coupling[1, j]
            d -= g * coupling[1, j]
            r[1] -= g * r[m + j]
    if m == 2:
        determinant = a * d - b * b
        r0 = (d * r[0] - b * r[1]) / determinant
        r[1] = (a * r[1] - b * r[0]) / determinant
        r[0] = r0
    else:
        r[0] /= a
    for j in range(n):
        r[m + j] -= coupling[0, j] * r[0]
        if m == 2:
            r[m + j] -= coupling[1, j] * r[1]
        r[m + j] /= modal[j]


@merged("joints", "coupling", "modal", "scale", "mu")
def solve_rows(
    joints: Matrix, coupling: Matrix, modal: Vector, scale: Vector, mu: Vector, rows: int
) -> None:
    """Replace mu by M^-1 mu, many right-hand sides at once; the blocks of M are destroyed.

    Args:
        joints, coupling, modal: the blocks of M, as terms has written them.
        scale: room for 1/modal, shape of modal.
        mu: in and out, flat: entry k rows + r is row k of right-hand side r, shape (n rows,).
        rows: how many right-hand sides.
    """
    m, n = coupling.shape
    # the modes eliminated, then the joints, then the modes again
    for k in range(n):
        scale[k] = 1.0 / modal[k]
        for j in range(m):
            entry = coupling[j, k] * scale[k]
            if entry != 0.0:
                for other in range(m):
                    joints[j, other] -= entry * coupling[other, k]
                for r in range(rows):
                    mu[j * rows + r] -= entry * mu[(m + k) * rows + r]
    if m > 2:
        cholesky(joints)
        for i in range(m):
            for k in range(i):
                for r in range(rows):
                    mu[i * rows + r] -= joints[i, k] * mu[k * rows + r]
            for r in range(rows):
                mu[i * rows + r] /= joints[i, i]
        for step in range(m):
            i = m - 1 - step
            for k in range(i + 1, m):
                for r in range(rows):
                    mu[i * rows + r] -= joints[k, i] * mu[k * rows + r]
            for r in range(rows):
                mu[i * rows + r] /= joints[i, i]
    elif m == 2:
        inverse = 1.0 / (joints[0, 0] * joints[1, 1] - joints[0, 1] * joints[1, 0])
        for r in range(rows):
            first, second = mu[r], mu[rows + r]
            mu[r] = inverse * (joints[1, 1] * first - joints[0, 1] * second)
            mu[rows + r] = inverse * (joints[0, 0] * second - joints[1, 0] * first)
    elif m == 1:
        inverse = 1.0 / joints[0, 0]
        for r in range(rows):
            mu[r] *= inverse
    for k in range(n):
        for j in range(m):
            if coupling[j, k] != 0.0:
                for r in range(rows):
                    mu[(m + k) * rows + r] -= coupling[j, k] * mu[j * rows + r]
        for r in range(rows):
            mu[(m + k) * rows + r] *= scale[k]
