"""By the peer's interpreter: pynumdiff's smoothers on tracks, tuned on one whose truth is known.

question: tune_m, truth_mps (n,), counted (2,n) bool: epochs of each leg; z_m (runs,n), step_s (). answer, for the
methods rts and savgol: NAME (runs,n,2) velocity and its difference quotient, NAME_words (): parameters; version ().
Parameters are those with the least of the larger leg's RMS error of velocity, over the methods' own settings.
"""

import itertools
import sys
import warnings
from typing import Any


def main() -> int:
    """Read the question, write the answer."""
    try:
        from pynumdiff.kalman_smooth import rtsdiff
        from pynumdiff.polynomial_fit import savgoldiff
    except ImportError as error:
        print(f"pynumdiff cannot be imported ({error})", file=sys.stderr)
        return 3
    from importlib.metadata import version

    import numpy as np

    warnings.simplefilter("ignore")
    asked = np.load(sys.argv[1])
    step_s, truth, counted = float(asked["step_s"]), asked["truth_mps"], asked["counted"]

    def rts(z, order, log_qr_ratio):
        return rtsdiff(z, step_s, order=order, log_qr_ratio=log_qr_ratio, forwardbackward=True)[1]

    def savgol(z, degree, window_size, smoothing_win):
        return savgoldiff(z, step_s, degree=degree, window_size=window_size, smoothing_win=smoothing_win)[1]

    grids: dict[str, tuple[Any, dict[str, Any]]] = {
        "rts": (rts, {"order": (2, 3), "log_qr_ratio": [float(k) for k in range(-12, 0)]}),
        "savgol": (
            savgol,
            {
                "degree": (2, 3, 4, 5, 7),
                "window_size": (31, 51, 91, 131, 201, 301, 401, 501),
                "smoothing_win": (3, 11, 31, 51, 91, 131),
            },
        ),
    }
    answer: dict[str, Any] = {"version": version("pynumdiff")}
    for name, (method, grid) in grids.items():
        best: dict[str, Any] = {}
        least = np.inf
        for values in itertools.product(*grid.values()):
            words = dict(zip(grid, values, strict=True))
            off = method(asked["tune_m"], **words) - truth
            worse = max(float(np.sqrt(np.mean(off[leg] ** 2))) for leg in counted)
            if worse < least:
                best, least = words, worse
        tracks = [method(z, **best) for z in asked["z_m"]]
        answer[name] = np.array([np.column_stack((v, np.gradient(v, step_s))) for v in tracks])
        answer[name + "_words"] = ", ".join(f"{word} {value:g}" for word, value in best.items())
    np.savez(sys.argv[2], **answer)
    return 0


if __name__ == "__main__":
    sys.exit(main())
