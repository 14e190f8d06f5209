"""Rayleigh-step bearing: load and friction of an oil film that narrows in one step.

What            pressure, load and friction for a given gap, sliding and squeeze; the gap and the squeeze for a given load
Equation        d/dx(h^3 dp/dx - Lambda h) = sigma dh/dt;  H = h + 1 for 0 <= x <= 1, h for 1 <= x <= 1 + alpha        (2.12)
                p = 0 at both ends. Pressure at the step, with s = sigma h':
                p_m = alpha (Lambda - s (1 + alpha)/2)/(h^3 + alpha H^3)                                        (2.24, 2.48)
                in each zone, y from its outer end, length l, height h_i:
                p = y (b + a y),  a = s/(2 h_i^3),  b = p_m/l - a l                                             (2.38, 2.41)
                W_n = integral of max(0, p) over both zones                                               (2.27, 2.49, 2.50)
                F_f = (dh/L) [max(0, p_m)/2 + Lambda/6 (1/H + alpha/h)]                                         (2.34, 2.51)
Assumptions     infinitely wide, rigid, isoviscous, no tilt; where the equation gives p < 0 the film cavitates at p = 0 (the
                solution is cut, fig 2.10) and keeps its shear
Valid range     h > 0; any sign of Lambda (negative: the film widens) and of s (positive: the gap opens)
Not modelled    conservation of mass in the cavity, pressure-dependent viscosity, temperature, wall contact
References      Janssens 2010, sec. 2.3.2

Units: x over L, h over the step height dh, t times omega; Lambda = 6 eta V L/dh^2 [Pa] (2.13),
sigma = 12 eta L^2 omega/dh^2 [Pa] (2.14); W_n and F_f are forces per width and per L [Pa].

In the print, p_m in 2.34 and 2.51 has a minus sign: that is the shear on the stepped surface without the pressure on the face
of its step (the print says "bottom surface"). The friction force, the same on both bodies, has a plus sign (see the tests).
The text after 2.29 drops alpha at contact; 2.52 keeps it and is right. Where sec. 5.6 gives
H_s = ((1 + alpha) Lambda/2W)^(1/3), h^3 is dropped beside alpha H^3: exact only for h -> 0.
"""

from numba import njit

NEWTON_STEPS = 60  # upper limit; 3 to 8 are taken


@njit(cache=True)
def threshold_sliding(alpha, load):
    """Return Lambda_0 [Pa] below which no gap carries the load W [Pa] in steady sliding (eq 2.52)."""
    return 2.0 * load / (1.0 + alpha)  # 2.52


@njit(cache=True)
def ridge_pressure(alpha, gap, sliding, squeeze):
    """Return p_m [Pa], the solution at the step, not cut; `gap` h [-], `sliding` Lambda [Pa], `squeeze` s = sigma h' [Pa]."""
    supply = sliding - 0.5 * squeeze * (1.0 + alpha)
    return alpha * supply / (gap**3 + alpha * (gap + 1.0) ** 3)  # 2.24, 2.48 with 2.46


@njit(cache=True)
def pressure(alpha, gap, sliding, squeeze, x):
    """Return p [Pa] at 0 <= `x` <= 1 + alpha [-], cut at 0."""
    ridge = ridge_pressure(alpha, gap, sliding, squeeze)
    y, length, height = (x, 1.0, gap + 1.0) if x <= 1.0 else (1.0 + alpha - x, alpha, gap)
    curvature = 0.5 * squeeze / height**3  # 2.36, 2.39
    return max(0.0, y * (ridge / length - curvature * length + curvature * y))  # 2.38, 2.41


@njit(cache=True)
def _zone(ridge, curvature, length, ridge_rate, curvature_rate):
    """Return the integral of max(0, p) over one zone (eq 2.50), and its derivative when p_m and a change at the given rates.

    p is a parabola with a root at the outer end and one at `width` from the step.
    """
    if curvature != 0.0:
        width = ridge / (curvature * length)
        width_rate = ridge_rate / (curvature * length) - width * curvature_rate / curvature
        if curvature > 0.0 and width < length:  # opening: cavity at the outer end
            if width <= 0.0:
                return 0.0, 0.0
            shape = 0.5 * length * width**2 - width**3 / 6.0
            return curvature * shape, curvature_rate * shape + curvature * (length - 0.5 * width) * width * width_rate
        if curvature < 0.0 and width > 0.0:  # closing: cavity at the step
            rest = max(length - width, 0.0)
            return -curvature * rest**3 / 6.0, 0.5 * curvature * rest**2 * width_rate - curvature_rate * rest**3 / 6.0
    elif ridge <= 0.0:
        return 0.0, 0.0
    third = length**3 / 6.0
    return 0.5 * ridge * length - curvature * third, 0.5 * ridge_rate * length - curvature_rate * third  # 2.49


@njit(cache=True)
def load_and_rate(alpha, gap, sliding, squeeze, gap_rate, squeeze_rate):
    """Return W_n [Pa] (eq 2.50), and its derivative when gap and squeeze change at the given rates."""
    wide = gap + 1.0
    resistance = gap**3 + alpha * wide**3
    ridge = alpha * (sliding - 0.5 * squeeze * (1.0 + alpha)) / resistance  # 2.48 with 2.46
    ridge_rate = -0.5 * alpha * (1.0 + alpha) * squeeze_rate / resistance
    ridge_rate -= 3.0 * ridge * (gap**2 + alpha * wide**2) / resistance * gap_rate
    far = 0.5 * squeeze / wide**3  # 2.36
    near = 0.5 * squeeze / gap**3  # 2.39
    far_rate = 0.5 * squeeze_rate / wide**3 - 3.0 * far / wide * gap_rate
    near_rate = 0.5 * squeeze_rate / gap**3 - 3.0 * near / gap * gap_rate
    load_far, rate_far = _zone(ridge, far, 1.0, ridge_rate, far_rate)
    load_near, rate_near = _zone(ridge, near, alpha, ridge_rate, near_rate)
    return load_far + load_near, rate_far + rate_near  # 2.50


@njit(cache=True)
def friction(alpha, gap, sliding, squeeze, slope):
    """Return F_f [Pa] with the sign of `sliding`; `slope` dh/L [-]. The pressure of a cavitated step does not pull.

    At Lambda < 0 the force that opposes the motion is negative; the pressure on the step pushes with p_m whatever the motion.
    """
    ridge = max(0.0, ridge_pressure(alpha, gap, sliding, squeeze))
    return slope * (0.5 * ridge + sliding / 6.0 * (1.0 / (gap + 1.0) + alpha / gap))  # 2.34, 2.51


@njit(cache=True)
def steady_gap(alpha, sliding, load):
    """Return h [-] at which the film carries `load` [Pa] in steady sliding (eq 2.27); 0 up to Lambda_0 (eq 2.52)."""
    if sliding <= threshold_sliding(alpha, load):
        return 0.0
    resistance = 0.5 * alpha * (1.0 + alpha) * sliding / load  # 2.27: h^3 + alpha H^3
    gap = (resistance / alpha) ** (1.0 / 3.0) - 1.0  # above the root, from where Newton's method falls onto it
    for _ in range(NEWTON_STEPS):
        wide = gap + 1.0
        change = (gap**3 + alpha * wide**3 - resistance) / (3.0 * (gap**2 + alpha * wide**2))
        gap -= change
        if abs(change) <= 1e-15 * gap:
            break
    return gap
