"""Small plants of COMPleib 1.1 (F. Leibfritz, 2005), typed as facts from its file COMPleib.m.

The H-infinity norms that are cited for HIFOO on them, with static output feedback, are those of
Gumussoy and Overton, Fixed-order H-infinity controller design via HIFOO (arXiv 2003.02295); its
tables were not compared.
"""

import numpy as np

from flexslew_lab.tuning.closed_loop import PerformancePlant
from flexslew_plant.arrays import Matrix

_HALF = np.sqrt(0.5)


def _plant(
    a: Matrix, b1: Matrix, b: Matrix, c1: Matrix, c: Matrix, d12: Matrix, d21: Matrix
) -> PerformancePlant:
    d = np.block([[np.zeros((len(c1), b1.shape[1])), d12], [d21, np.zeros((len(c), b.shape[1]))]])
    return PerformancePlant(a, np.hstack((b1, b)), np.vstack((c1, c)), d, b.shape[1], len(c))


def he1() -> PerformancePlant:
    """Longitudinal motion of a VTOL helicopter (Singh and Coelho 1984)."""
    a = [[-0.0366, 0.0271, 0.0188, -0.4555], [0.0482, -1.01, 0.0024, -4.0208],
         [0.1002, 0.3681, -0.7070, 1.42], [0.0, 0.0, 1.0, 0.0]]  # fmt: skip
    b = [[0.4422, 0.1761], [3.5446, -7.5922], [-5.52, 4.49], [0.0, 0.0]]
    b1 = [[4.678e-2, 0.0], [4.572e-2, 9.88e-3], [4.369e-2, 1.11e-3], [-2.179e-2, 0.0]]
    c1 = _HALF * np.array([[2.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
    c = np.array([[0.0, 1.0, 0.0, 0.0]])
    return _plant(
        np.array(a), np.array(b1), np.array(b), c1, c, _HALF * np.eye(2), np.zeros((1, 2))
    )


def rea2() -> PerformancePlant:
    """A chemical reactor (Hung and MacFarlane 1982), with two of its measurements."""
    a = [[1.4, -0.208, 6.715, -5.676], [-0.581, -4.29, 0.0, 0.675],
         [1.067, 4.273, -6.654, 5.893], [0.048, 4.273, 1.343, -2.104]]  # fmt: skip
    b = [[0.0, 0.0], [5.679, 0.0], [1.136, -3.146], [1.136, 0.0]]
    c = [[1.0, 0.0, 1.0, -1.0], [0.0, 1.0, 0.0, 0.0]]
    d12 = np.vstack((np.zeros((2, 2)), np.eye(2)))
    return _plant(
        np.array(a), np.eye(4), np.array(b), np.eye(4), np.array(c), d12, np.zeros((2, 4))
    )


def ac8() -> PerformancePlant:
    """A transport aircraft in cruise (Gangsaas, Bruce, Blight and Ly 1986)."""
    a = np.zeros((9, 9))
    a[0] = [-0.01365, 0.178, 0.00017, -0.561, -0.03726, 0.0, 0.01365, -0.01311, 0.0]
    a[1] = [-0.01516, -0.752, 1.001, 0.00127, -0.06311, 0.0, 0.01516, 0.05536, 0.0]
    a[2] = [0.00107, 0.07896, -0.8725, 0.0, -3.399, 0.0, -0.00107, -0.00581, 0.0]
    a[3, 2] = 1.0
    a[4, 4:6], a[5, 5] = (-20.0, 10.72), -50.0
    a[6:, 6:] = -0.4447 * np.eye(3)
    a[7, 8], a[8, 7] = 0.0044, -0.0044
    b, b1 = np.zeros((9, 1)), np.zeros((9, 10))
    b[5] = b1[5, 4] = 50.0
    b1[0, 3], b1[6, 0], b1[7, 1], b1[8, 1] = 1.0, 0.9431, 1.155, -48.82
    c = np.zeros((5, 9))
    c[0] = [0.00646, 0.3203, -0.03358, 0.0, -0.1032, 0.0, -0.00646, -0.02358, 0.0]
    c[1, 0], c[1, 6], c[4, 2] = 1.0, -1.0, 1.0
    c[2], c[3, 1], c[3, 3] = a[0], -13.58, 13.58
    d21 = np.zeros((5, 10))
    d21[range(5), (7, 5, 6, 9, 8)] = 1.0
    return _plant(a, b1, b, 0.5 * c[:2], c, 0.5 * np.ones((2, 1)), d21)
