"""By the peer's interpreter: gnss_lib_py's fault detection and exclusion on epochs, and what it takes.

question: count (m,), range_m (m,64), r_m (m,64,3), threshold (m,), method (), max_faults (). answer: excluded (m,64),
seconds (m,) of processor time within the call, version ().
"""

import sys
import time
import warnings


def main() -> int:
    """Read the question, write the answer."""
    try:
        import gnss_lib_py
        from gnss_lib_py.algorithms.fde import solve_fde
    except ImportError as error:
        print(f"gnss_lib_py cannot be imported ({error})", file=sys.stderr)
        return 3
    from importlib.metadata import version

    import numpy as np

    warnings.simplefilter("ignore")
    asked = np.load(sys.argv[1])
    count, range_m, r_m, threshold = (asked[name] for name in ("count", "range_m", "r_m", "threshold"))
    method = str(asked["method"])
    excluded, seconds = np.zeros(range_m.shape, bool), np.zeros(len(count))
    for k, n in enumerate(count.tolist()):
        epoch = gnss_lib_py.NavData()
        epoch["gps_millis"] = np.full(n, 1e12)
        epoch["x_sv_m"], epoch["y_sv_m"], epoch["z_sv_m"] = r_m[k, :n].T
        epoch["b_sv_m"] = np.zeros(n)
        epoch["corr_pr_m"] = range_m[k, :n]
        before = time.process_time()
        found = solve_fde(epoch, method=method, max_faults=int(asked["max_faults"]), threshold=float(threshold[k]))
        seconds[k] = time.process_time() - before
        excluded[k, :n] = np.atleast_1d(found["fault_" + method]) == 1
    np.savez(sys.argv[2], excluded=excluded, seconds=seconds, version=version("gnss_lib_py"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
