#!/usr/bin/env python3
"""How near what no class stands for lies to a class, in standard deviations of a healthy signal: of one of any channel, and of
one about its own channel's level. See README.md.

    python3 tests/outside/geometry.py"""
import pathlib, sys
import numpy as np
from scipy.optimize import least_squares
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import head as H

NOISE, SLOW = 11.0, .06  # counts; rate of the slow part beside the ring, 1/us
T = np.arange(H.N) * H.DT
FOREIGN = {
    "wider nozzle, 15 %": ("EC", [dict(In=1 / 1.15, Rn=1.15 ** -2, Rs=1.15 ** -1.5)]),
    "wider restrictor": ("EC", [dict(Ir=.85, Rr=.75), dict(Ir=.7, Rr=.5)]),
    "heavier restrictor": ("PBN", [dict(Ir=1.2), dict(Ir=1.5)]),
    "heavier, thicker restrictor": ("PBN", [dict(Ir=1.1, Rr=1.2), dict(Ir=1.5, Rr=2.2)]),
    "thick ink": ("SDN", [dict(Rr=f, Rn=f, Rs=f, Rc=f) for f in (1.15, 1.8)]),
    "stiffer meniscus": ("AB1", [dict(Cm=.4), dict(Cm=.2)]),
    "longer nozzle": ("AB2", [dict(In=1.3, Rn=1.3, Rs=1.3)]),
}
SIZES = dict(EC=np.linspace(.02, .6, 117), PBN=np.linspace(.02, .8, 157), SDN=np.linspace(1.02, 2, 99),
             AB1=np.linspace(.02, .6, 59), AB2=np.linspace(.02, 1, 99))


def features(y, start):
    """ln amplitude, ln damping, ln frequency and phase of the ring that fits best, a slow part beside it"""
    def fit(x):
        s, w = np.exp(x)
        columns = np.stack([np.exp(-s * T) * np.cos(w * T), np.exp(-s * T) * np.sin(w * T), np.exp(-SLOW * T)], 1)
        c = np.linalg.lstsq(columns, y, rcond=None)[0]
        return c, columns @ c - y
    x = least_squares(lambda x: fit(x)[1], start, method="lm").x
    c = fit(x)[0]
    return np.array([np.log(np.hypot(c[0], c[1])), *x, np.arctan2(-c[1], c[0])])


def main():
    rng, nominal = np.random.default_rng(3), H.nominal(1)
    ring = lambda p, noise=0.0: features(H.waves(p)[0] + noise * rng.standard_normal(H.N), start)
    start = np.log([.025, .33])
    healthy = ring(nominal)
    start = healthy[1:3]
    any_channel = np.cov([ring(p[None], NOISE) for p in H.healthy(rng, 300)], rowvar=False)
    own_channel = np.cov([ring(nominal, NOISE) for _ in range(300)], rowvar=False)
    curves = {k: np.array([ring(H.fault(nominal, k, s)) for s in sizes]) for k, sizes in SIZES.items()}
    print(f"{'what':28} class  any channel  own channel")
    for what, (k, changes) in FOREIGN.items():
        for change in changes:
            p = nominal.copy()
            for element, by in change.items():
                p[:, H.IX[element]] *= by
            off = curves[k] - ring(p)
            far = [np.sqrt(np.einsum("ij,jk,ik->i", off, np.linalg.inv(c), off).min()) for c in (any_channel, own_channel)]
            print(f"{what:28} {k:5}  {far[0]:11.1f}  {far[1]:11.1f}")


if __name__ == "__main__":
    main()
