"""Life cycle of asperities: free, stick, slip, loss of contact; and the load balance of the body that carries them.

What            the jitted parts of the Generic model (`generic.py`), each usable alone; the Generic-Rayleigh model puts
                lubricated slip between them
Functions       friction_coefficient    mu after a time in stick
                search_contacts         1. tips move, contacts end and begin
                balanced_separation     2. separation z_b at which the asperities bear the load
                adhesive_contact        3. stick and slip of one asperity in contact (scalars in and out)
                hold_and_slide          3. the same for all asperities; returns the tangential force
                inertial_force          4. impact losses of all asperities
Equation        F_t += k_t dx in stick, |F_t| <= mu(t) k_n zeta                                        (2.3, 2.6, 2.7)
                mu(t) = mu_0 + (mu_inf - mu_0) (1 - exp(-t/tau)), t the time in stick                    (2.2)
                zeta_i = 1 - z_i - z_b, W_i = k_n zeta_i > 0 only over a step                            (2.4, 2.5)
                F_m = m v^2 / (2 (1 + alpha) w)                                                          (2.9)
Assumptions     the tip carries the contact: in stick it rests while its spring extends, and contact is lost when the *tip*
                has crossed the step (fig 2.2). It then springs back to the undeflected position at once, all energy lost;
                if that is already over the next step, contact begins there.
                In slip t = 0, so the force drops to mu_0 W_i: without that drop fig 2.8 would not overshoot.
                A tip slides back when unloading takes its limit below its force; when loading takes the limit above it, the
                force rises with the spring only, k_t dx. Slip becomes stick at reversal or standstill of the body alone.
                F_m acts over the whole pitch on each asperity that reaches the steps (zeta_i > 0), so that each passage
                takes m v^2/2; at standstill it is 0.
Valid range     |displacement| of one call at most the narrowest step or recess (the laws of `generic.py` divide it)
References      Janssens 2010, secs. 2.2.1-2.2.3; Al-Bender, Lampaert and Swevers 2004 for the original, energy-based model

Arrays over N asperities, float64: `force` F_t, `stick_time` t, `mode` (FREE, STICK, or the sign of the slip), `place`
(segment of the counter surface under the tip, `counter_surface.segment_at`); these four are the state and written in place.
`travelled` is how far the body moved since the present contact began, at most the displacement; `reach` is 1 - z_i where
the tip is over a step and -infinity elsewhere.
"""

from math import exp, inf

from numba import njit

from plant_sim.friction.counter_surface import edge, segment_at

FREE, STICK, SLIP_UP, SLIP_DOWN = 2.0, 0.0, 1.0, -1.0


@njit(inline="always")
def friction_coefficient(stick_time, mu_0, mu_inf, tau):
    """Return the friction coefficient mu [-] after `stick_time`; `tau` in the same unit."""
    return mu_0 + (mu_inf - mu_0) * (1.0 - exp(-stick_time / tau))  # 2.2


@njit(inline="always")
def _arrival(start, end, hint, edges, period):
    """Return the segment at `end`, and the distance moved in it since an edge was crossed; 0 if none was crossed."""
    segment = segment_at(end, hint, edges, period)
    if segment > hint:
        return segment, end - max(start, edge(segment, edges, period))
    if segment < hint:
        return segment, end - min(start, edge(segment + 1, edges, period))
    return segment, 0.0


@njit(cache=True)
def search_contacts(
    body, displacement, position, height, stiffness, edges, period, force, stick_time, mode, place, travelled, reach
):
    """Move the body from `body` by `displacement`; write `place`, `travelled`, `reach`, and the state of lost contacts.

    `position`, `height` z, `stiffness` k_t (N,); `edges` of one `period` of the counter surface.
    """
    for i in range(position.size):
        segment = int(place[i])
        base = position[i] + body + displacement
        if mode[i] == STICK:
            travelled[i] = displacement  # the tip rests
        elif mode[i] == FREE:
            segment, travelled[i] = _arrival(base - displacement, base, segment, edges, period)
        else:
            slides = mode[i] * displacement > 0.0
            tip = base - force[i] / stiffness[i] - (0.0 if slides else displacement)  # 2.6
            ahead = edge(segment + 1 if mode[i] == SLIP_UP else segment, edges, period)
            beyond = mode[i] * (tip - ahead)
            travelled[i] = displacement
            if beyond > 0.0:  # loss of contact, with all energy (sec. 2.2.3)
                force[i], stick_time[i] = 0.0, 0.0
                rest = mode[i] * min(beyond, abs(displacement)) if slides else displacement
                mode[i] = FREE
                segment = segment_at(base - rest, segment, edges, period)  # the tip is back under its base
                travelled[i] = rest
                if segment % 2 == 1:
                    segment, travelled[i] = _arrival(base - rest, base, segment, edges, period)
        place[i] = segment
        reach[i] = 1.0 - height[i] if segment % 2 == 0 else -inf  # 2.4


@njit(cache=True)
def balanced_separation(reach, stiffness, load, slope, guess):
    """Return the separation z_b at which the asperities bear the load: sum k_n max(0, reach - z_b) = load + slope z_b.

    Exact (Newton's method on a convex, piecewise linear, falling function ends after finitely many steps) from any `guess`.
    `stiffness` k_n (N,). Without any asperity over a step, and slope 0, the body stays at `guess`.
    """
    separation, before = guess, -1
    while True:
        total, moment, count = slope, -load, 0
        for i in range(reach.size):
            if reach[i] > separation:
                total += stiffness[i]
                moment += stiffness[i] * reach[i]
                count += 1
        if count == before:
            return separation
        if count == 0 and slope == 0.0:  # above all asperities: start below the lowest instead
            if before >= 0:
                return separation
            separation = inf
            for i in range(reach.size):
                if reach[i] > -inf:
                    separation = min(separation, reach[i] - 1.0)
            if separation == inf:
                return guess
            continue
        separation, before = moment / total, count  # sum over the active asperities of 2.4 and 2.5


@njit(inline="always")
def adhesive_contact(force, stick_time, mode, travelled, displacement, dt, stiffness, normal_force, mu_0, mu_inf, tau):
    """Return the force, stick time and mode of one asperity in contact under `normal_force`, after `displacement` in `dt`."""
    trial = force + stiffness * travelled  # 2.3
    if mode * displacement > 0.0 and mode != FREE:  # slips on; when the load rises the spring must follow first
        return mode * min(mode * trial, mu_0 * normal_force), 0.0, mode  # 2.7
    stick_duration = dt if displacement == 0.0 else dt * travelled / displacement
    time = stick_time + stick_duration  # at reversal or standstill slip becomes stick, from 0 on
    if abs(trial) > mu_0 * normal_force and abs(trial) > normal_force * friction_coefficient(time, mu_0, mu_inf, tau):
        slip = SLIP_UP if trial > 0.0 else SLIP_DOWN
        return slip * mu_0 * normal_force, 0.0, slip  # 2.7
    return trial, time, STICK


@njit(cache=True)
def hold_and_slide(
    reach, separation, tangential, normal, travelled, displacement, dt, mu_0, mu_inf, tau, force, stick_time, mode
):
    """Update stick, slip or freedom of all asperities at `separation` z_b; return the sum of their tangential forces.

    `tangential` k_t, `normal` k_n (N,).
    """
    total = 0.0
    for i in range(reach.size):
        deflection = reach[i] - separation  # 2.4
        if deflection > 0.0:
            force[i], stick_time[i], mode[i] = adhesive_contact(
                force[i],
                stick_time[i],
                mode[i],
                travelled[i],
                displacement,
                dt,
                tangential[i],
                normal[i] * deflection,
                mu_0,
                mu_inf,
                tau,
            )
            total += force[i]
        else:
            force[i], stick_time[i], mode[i] = 0.0, 0.0, FREE
    return total


@njit(cache=True)
def inertial_force(velocity, height, separation, mass, place, inverse_pitch):
    """Return the mean force of the impacts at `velocity`; `mass` (N,), `inverse_pitch` (2 N_w,) in the direction of motion."""
    if velocity == 0.0:
        return 0.0
    total = 0.0
    for i in range(place.size):
        if 1.0 - height[i] > separation:
            segment = int(place[i])
            total += mass[i] * inverse_pitch[segment % inverse_pitch.size]
    return 0.5 * velocity * abs(velocity) * total if total > 0.0 else 0.0  # 2.9
