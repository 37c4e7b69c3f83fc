"""A printhead of its own physics: a lumped acoustic ladder, integrated exactly.

Not inkling's (2-2): the chamber is three compliances joined by lossy inertances, the nozzle has a loss that depends on
frequency (R in parallel with L, a Foster cell, in series) and a meniscus with surface tension, the restrictor ends in a
supply of finite compliance, and the sensed signal is a weighted sum of chamber pressures and the piezo's own damped
mode. 12 states, microseconds inside.
"""
import numpy as np
from scipy.linalg import expm

# inertances in 1/us^2 relative to B = 1; resistances over inertance: rates, 1/us
NOMINAL = dict(gain=1.0, Ir=24.0, Rr=24.0 * 0.011, In=13.0, Rn=13.0 * 0.040, Rs=0.9, B=1.0, Ic=0.35,
               Rc=0.35 * 0.05, Cm=60.0, k=0.012, act=1.0)
IX = {name: i for i, name in enumerate(NOMINAL)}
N, DT = 128, 0.78  # samples, us
COUNTS = 760.0


def scaled(p, **by):
    """Channels whose elements are multiplied."""
    p = p.copy()
    for name, factor in by.items():
        p[:, IX[name]] *= factor
    return p


def healthy(rng, rows):
    """Lasting differences: about .4 % in frequency, 1 % in damping and amplitude."""
    sds = dict(gain=.009, Ir=.006, Rr=.012, In=.009, Rn=.011, Rs=.01, B=.006, Ic=.01, Rc=.02, Cm=.02, k=.05)
    own = {name: np.exp(sd * np.clip(rng.standard_normal(rows), -2.5, 2.5)) for name, sd in sds.items()}
    return scaled(np.tile(list(NOMINAL.values()), (rows, 1)), **own)


def warm(p, kelvin):
    """Ink that is warmer: less viscous, a little more compliant, less dense."""
    thin, light = np.exp(-.021 * kelvin), np.exp(-.0006 * kelvin)
    return scaled(p, Rr=thin, Rn=thin, Rs=thin, Rc=thin, B=np.exp(.0013 * kelvin), Ir=light, In=light, Ic=light,
                  gain=np.exp(.0008 * kelvin))


def fault(p, kind, s):
    """s: in the unit of inkling's labels (blocked share, viscosity factor, missing density ...)."""
    if kind in ("PBN", "BN"):  # narrower nozzle
        return scaled(p, In=1 / (1 - s), Rn=1 / (1 - s) ** 2, Rs=1 / (1 - s) ** 1.5)
    if kind in ("SDN", "IDN", "DDN"):  # more viscous ink in the nozzle
        return scaled(p, Rn=s, Rs=s)
    if kind == "EC":  # emptied: less mass, less loss
        light, thin = 1 - s, (1 - s) ** 2
        return scaled(p, In=light, Ic=light, Ir=light, Rn=thin, Rs=thin, Rr=thin, Rc=thin)
    if kind == "AB1":  # air in the nozzle
        return scaled(p, In=1 - s, Rn=1 - s)
    return scaled(p, B=1 + s, Rc=1 + .3 * s)  # AB2, AB3: air in the chamber


def matrices(p):
    g = lambda name: p[:, IX[name]]
    A = np.zeros((len(p), 12, 12))
    b = g("B") / 3
    # 0..2 chamber pressures, 3 restrictor's flow, 4 5 flows between, 6 nozzle's flow, 7 Foster cell's current,
    # 8 meniscus pressure, 9 supply pressure, 10 11 piezo's mode
    for k in range(3):
        A[:, k, 3 + k], A[:, k, 4 + k] = 1 / b, -1 / b
    A[:, 3, 9], A[:, 3, 0], A[:, 3, 3] = 1 / g("Ir"), -1 / g("Ir"), -g("Rr") / g("Ir")
    for flow in (4, 5):
        A[:, flow, flow - 4], A[:, flow, flow - 3], A[:, flow, flow] = 1 / g("Ic"), -1 / g("Ic"), -g("Rc") / g("Ic")
    corner = .30  # of the Foster cell, 1/us
    A[:, 6, 2], A[:, 6, 8], A[:, 6, 7] = 1 / g("In"), -1 / g("In"), g("Rs") / g("In")
    A[:, 6, 6] = -(g("Rn") + g("Rs")) / g("In")
    A[:, 7, 6], A[:, 7, 7] = corner, -corner
    A[:, 8, 6], A[:, 8, 8] = 1 / g("Cm"), -.004
    A[:, 9, 3], A[:, 9, 9] = -1 / 800.0, -.002
    w, z = 2 * np.pi * .19, .08  # 190 kHz
    A[:, 10, 11], A[:, 11, 10], A[:, 11, 11], A[:, 11, 1] = 1.0, -w * w, -2 * z * w, w * w * g("k")
    return A


def waves(p, dt=DT):
    """Free decays (rows, N) in counts, without noise: trapezoid pulse, wait, ring."""
    A = matrices(p)
    kick = np.zeros((len(p), 12, 1))
    kick[:, :3, 0] = (p[:, IX["act"]] / p[:, IX["B"]])[:, None]
    x = expm(A * 6.4) @ (expm(A * 8.7) @ kick - kick)  # rising edge and plateau; falling edge and dead time
    step, out = expm(A * dt), np.empty((len(p), N), np.float32)
    sensed = np.zeros((1, 12))
    sensed[0, :3], sensed[0, 10] = [.30, .45, .25], .5
    for k in range(N):
        out[:, k] = (sensed @ x)[:, 0, 0] * p[:, IX["gain"]] * COUNTS
        x = step @ x
    return out
