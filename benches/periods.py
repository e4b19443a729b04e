#!/usr/bin/env python3
"""Times the peers of `sunglint_analysis::period` and states their errors, on the job of analysis/benches/period.rs.

One core: OMP_NUM_THREADS=1 benches/periods.py
Needs astropy, and where they are there nifty-ls (pip install nifty-ls) and PyAstronomy.
The truth is weighted least squares at 200 of the frequencies by numpy's QR, no trigonometric sums.
"""

import time

import numpy as np
from astropy import __version__ as astropy_version
from astropy.timeseries import LombScargle

N, FIRST, STEP, COUNT = 2600, 0.01, 1e-4, 50_000


def samples():
    """The same generator as in period.rs."""
    state = 1

    def random():
        nonlocal state
        state = (state * 6364136223846793005 + 1442695040888963407) % 2**64
        return (state >> 11) / 2.0**53

    t = np.array([1000.0 * random() for _ in range(N)])
    w = 2 * np.pi / 20.0
    y = np.array([10.0 + np.sin(w * x) + 0.5 * np.cos(2 * w * x) + random() - 0.5 for x in t])
    return t, y, np.full(N, 0.3)


def truth(t, y, f):
    def left(columns):
        q, _ = np.linalg.qr(np.stack(columns, axis=1))
        r = y - q @ (q.T @ y)
        return r @ r

    one = np.ones_like(t)
    phase = 2 * np.pi * np.mod(f * (t - 500.0), 1.0)
    return 1.0 - left([one, np.cos(phase), np.sin(phase)]) / left([one])


def timed(name, run, frequency, which, right):
    best, power = np.inf, None
    for _ in range(5):
        start = time.process_time()
        power = run()
        best = min(best, time.process_time() - start)
    print(f"{name:<28} {1e3 * best:9.1f} ms   off by {np.abs(power[which] - right).max():.1e}")


def main():
    t, y, s = samples()
    f = FIRST + STEP * np.arange(COUNT)
    which = np.linspace(0, COUNT - 1, 200).astype(int)
    right = np.array([truth(t, y, f[i]) for i in which])
    ls = LombScargle(t, y, s)
    for method in ("fast",):
        run = lambda: ls.power(f, method=method, assume_regular_frequency=True)
        timed(f"astropy {astropy_version} {method}", run, f, which, right)
    try:
        import nifty_ls
    except ImportError:
        print("nifty-ls is not here")
    else:
        run = lambda: nifty_ls.lombscargle(t, y, s, fmin=f[0], fmax=f[-1], Nf=COUNT, nthreads=1).power
        timed(f"nifty-ls {nifty_ls.__version__}", run, f, which, right)
    try:
        from PyAstronomy import __version__ as version
        from PyAstronomy.pyTiming import pyPDM
    except ImportError:
        print("PyAstronomy is not here")
    else:
        scanner = pyPDM.Scanner(minVal=5.0, maxVal=60.0, dVal=0.01, mode="period")
        start = time.process_time()
        pyPDM.PyPDM(t - t.min(), y).pdmEquiBin(20, scanner)
        print(f"PyAstronomy {version} PDM, 5,500  {1e3 * (time.process_time() - start):9.1f} ms")


if __name__ == "__main__":
    main()
