"""A printhead of its own physics: a lumped acoustic ladder, integrated exactly.

Not inkling's (2-2): the chamber is three compliances joined by lossy inertances, the nozzle has a
frequency dependent loss (R in parallel with L, a Foster cell, in series) and a meniscus with surface
tension, the restrictor ends in a supply of finite compliance, and the sensed signal is a weighted
difference of chamber pressures and the piezo's own damped mode. 12 states, microseconds inside.
"""
import numpy as np
from scipy.linalg import expm

NAMES = ["gain", "Ir", "Rr", "In", "Rn", "Rs", "B", "Ic", "Rc", "Cm", "k", "act", "bub"]
IX = {n: i for i, n in enumerate(NAMES)}
# inertances in 1/(us^2) units relative to B = 1; resistances over inertance = rate 1/us
NOMINAL = dict(gain=1.0, Ir=24.0, Rr=24.0 * 0.011, In=13.0, Rn=13.0 * 0.040, Rs=0.9, B=1.0, Ic=0.35,
               Rc=0.35 * 0.05, Cm=60.0, k=0.012, act=1.0, bub=0.0)
N, DT = 128, 0.78  # samples, us


def nominal(rows=1):
    return np.tile(np.array([NOMINAL[n] for n in NAMES]), (rows, 1))


def healthy(rng, rows):
    """Lasting differences: about .4 % in frequency, 1 % in damping and amplitude."""
    p = nominal(rows)
    s = dict(gain=.009, Ir=.006, Rr=.012, In=.009, Rn=.011, Rs=.01, B=.006, Ic=.01, Rc=.02, Cm=.02, k=.05)
    for n, sd in s.items():
        p[:, IX[n]] *= np.exp(sd * np.clip(rng.standard_normal(rows), -2.5, 2.5))
    return p


def warm(p, kelvin):
    """Ink that is warmer: less viscous, a little more compliant, less dense."""
    p = p.copy()
    v = np.exp(-.021 * kelvin)
    for n in ("Rr", "Rn", "Rs", "Rc"):
        p[:, IX[n]] *= v
    p[:, IX["B"]] *= np.exp(.0013 * kelvin)
    for n in ("Ir", "In", "Ic"):
        p[:, IX[n]] *= np.exp(-.0006 * kelvin)
    p[:, IX["gain"]] *= np.exp(.0008 * kelvin)
    return p


def fault(p, kind, size):
    """size: the unit of inkling's labels (blocked share, viscosity factor, missing density, ...)."""
    p = p.copy()
    s = np.asarray(size, float)
    m = lambda n, f: p.__setitem__((slice(None), IX[n]), p[:, IX[n]] * f)
    if kind in ("PBN", "BN"):       # narrower nozzle
        m("In", 1 / (1 - s)); m("Rn", 1 / (1 - s) ** 2); m("Rs", 1 / (1 - s) ** 1.5)
    elif kind in ("SDN", "IDN", "DDN"):   # more viscous ink in the nozzle
        m("Rn", s); m("Rs", s)
    elif kind == "EC":              # channel emptied: less mass, less loss
        for n in ("In", "Ic", "Ir"):
            m(n, 1 - s)
        for n in ("Rn", "Rs", "Rr", "Rc"):
            m(n, (1 - s) ** 2)
    elif kind == "AB1":             # air in the nozzle
        m("In", 1 - s); m("Rn", 1 - s)
    elif kind in ("AB2", "AB3"):    # air in the chamber: compliance, a little loss
        m("B", 1 + s); m("Rc", 1 + .3 * s)
    elif kind == "LOSSY":           # of no class: leaky restrictor
        m("Rr", 1 + 6 * s); m("Ir", 1 - .3 * s)
    elif kind == "TWO":             # of no class: a second resonator couples
        p[:, IX["bub"]] = s
    else:
        raise KeyError(kind)
    return p


def matrices(p):
    m = len(p)
    g = lambda n: p[:, IX[n]]
    A = np.zeros((m, 14, 14))
    b = g("B") / 3
    # 0..2 pressures p1 p2 p3; 3 qr, 4 q12, 5 q23, 6 qn, 7 Foster current, 8 meniscus pressure,
    # 9 supply pressure, 10 11 piezo mode, 12 13 a foreign resonator (bub)
    A[:, 0, 3] = 1 / b; A[:, 0, 4] = -1 / b
    A[:, 1, 4] = 1 / b; A[:, 1, 5] = -1 / b
    A[:, 2, 5] = 1 / b; A[:, 2, 6] = -1 / b
    A[:, 3, 9] = 1 / g("Ir"); A[:, 3, 0] = -1 / g("Ir"); A[:, 3, 3] = -g("Rr") / g("Ir")
    A[:, 4, 0] = 1 / g("Ic"); A[:, 4, 1] = -1 / g("Ic"); A[:, 4, 4] = -g("Rc") / g("Ic")
    A[:, 5, 1] = 1 / g("Ic"); A[:, 5, 2] = -1 / g("Ic"); A[:, 5, 5] = -g("Rc") / g("Ic")
    rs, ls = g("Rs"), g("Rs") / .30          # Foster cell: corner at .30/us
    A[:, 6, 2] = 1 / g("In"); A[:, 6, 8] = -1 / g("In")
    A[:, 6, 6] = -(g("Rn") + rs) / g("In"); A[:, 6, 7] = rs / g("In")
    A[:, 7, 6] = rs / ls; A[:, 7, 7] = -rs / ls
    A[:, 8, 6] = 1 / g("Cm"); A[:, 8, 8] = -.004
    A[:, 9, 3] = -1 / 800.0; A[:, 9, 9] = -.002
    w, z = 2 * np.pi * .19, .08              # piezo's own mode, 190 kHz
    A[:, 10, 11] = 1.0
    A[:, 11, 10] = -w * w; A[:, 11, 11] = -2 * z * w; A[:, 11, 1] = w * w * g("k")
    wb = 2 * np.pi * .093
    A[:, 12, 13] = 1.0
    A[:, 13, 12] = -wb * wb; A[:, 13, 13] = -.04; A[:, 13, 1] = wb * wb * g("bub")
    A[:, 1, 13] += -.35 * g("bub") / b / 3 / wb
    return A


def waves(p, dt=DT, n=N):
    """Free decays (rows, n) in counts, without noise: trapezoid pulse, wait, ring; all by expm."""
    p = np.atleast_2d(p)
    out = np.empty((len(p), n), np.float32)
    for lo in range(0, len(p), 2000):
        q = p[lo:lo + 2000]
        A = matrices(q)
        x = np.zeros((len(q), 14, 1))
        x[:, 0:3, 0] = (1 / (q[:, IX["B"]]))[:, None] * q[:, IX["act"]][:, None]
        x = expm(A * 8.7) @ x                # rising edge, plateau
        x[:, 0:3, 0] -= (1 / (q[:, IX["B"]]))[:, None] * q[:, IX["act"]][:, None]
        x = expm(A * 6.4) @ x                # falling edge, dead time
        step = expm(A * dt)
        c = np.zeros((1, 14)); c[0, :3] = [.30, .45, .25]; c[0, 10] = .5
        for k in range(n):
            out[lo:lo + len(q), k] = (c @ x)[:, 0, 0] * q[:, 0] * COUNTS
            x = step @ x
    return out


COUNTS = 760.0
