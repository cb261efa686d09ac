"""Sine and cosine without a branch, for loops over members that become vector instructions."""

from flexslew_plant.arrays import vectorised

# pi / 2 in three parts, the first two short, so that multiples of them are exact (Cody and Waite)
_P1, _P2, _P3 = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21
_ROUND = 6755399441055744.0  # 1.5 * 2**52: adding and subtracting it rounds to an integer


@vectorised
def small(r: float) -> tuple[float, float]:
    """Return sin and cos of an angle between -pi/4 and pi/4, to one unit in the last place."""
    z = r * r
    y = z * z
    # pairs of terms, which need not wait for each other
    s1 = 8.33333333332248946124e-03 + z * -1.98412698298579493134e-04
    s2 = 2.75573137070700676789e-06 + z * -2.50507602534068634195e-08
    s3 = s2 + y * 1.58969099521155010221e-10
    s = r + r * z * (-1.66666666666666324348e-01 + z * (s1 + y * s3))
    c1 = 4.16666666666666019037e-02 + z * -1.38888888888741095749e-03
    c2 = 2.48015872894767294178e-05 + z * -2.75573143513906633035e-07
    c3 = 2.08757232129817482790e-09 + z * -1.13596475577881948265e-11
    c = 1.0 - 0.5 * z + y * (c1 + y * (c2 + y * c3))
    return s, c


@vectorised
def sine_cosine(angle: float) -> tuple[float, float]:
    """Return sin and cos of an angle below 1e5 rad, to one unit in the last place."""
    multiple = (angle * 0.6366197723675814 + _ROUND) - _ROUND
    r = ((angle - multiple * _P1) - multiple * _P2) - multiple * _P3
    s, c = small(r)
    remainder = multiple - 4.0 * ((0.25 * multiple + _ROUND) - _ROUND)  # -2, -1, 0, 1 or 2
    odd = remainder * remainder == 1.0
    a, b = (c if odd else s), (s if odd else c)
    sine = -a if (remainder < -0.5 or remainder > 1.5) else a
    cosine = -b if (remainder > 0.5 or remainder < -1.5) else b
    return sine, cosine


@vectorised
def angle_sum(sine: float, cosine: float, by: float) -> tuple[float, float]:
    """Return sin and cos of an angle that has turned by at most pi/4 since those given."""
    s, c = small(by)
    return sine * c + cosine * s, cosine * c - sine * s
