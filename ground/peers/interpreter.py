"""Ask a library that lives in another interpreter: arrays in, arrays out, by files in a temporary folder.

Peers pin versions of their own (gnss_lib_py wants an older pandas and georinex than ours): they cannot share our
environment. `constraints-peers.txt` pins theirs.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from ground.errors import OperatorError

HOW = "make one with python -m venv PEERS; PEERS/bin/pip install -c constraints-peers.txt gnss_lib_py pynumdiff"
_HERE = Path(__file__).resolve().parent
_ABSENT = 3  # exit code of a script whose library is not there


class PeerAbsent(OperatorError):
    """The interpreter is there, the library is not."""


def ask(python: Path, script: str, timeout_s: float = 36_000.0, **arrays: np.ndarray) -> dict[str, np.ndarray]:
    """What a script of this folder answers to arrays. Raises OperatorError, PeerAbsent where the library is absent."""
    with tempfile.TemporaryDirectory() as folder:
        question, answer = Path(folder) / "question.npz", Path(folder) / "answer.npz"
        np.savez(question, **arrays)  # type: ignore[arg-type]
        command = [str(python), "-I", str(_HERE / script), str(question), str(answer)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, check=False)
        except OSError as error:
            raise OperatorError(f"--peer-python {python}: cannot be run: {error.strerror}; {HOW}") from error
        except subprocess.TimeoutExpired:
            raise OperatorError(f"{script}: no answer in {timeout_s:.0f} s") from None
        if done.returncode == _ABSENT:
            raise PeerAbsent(f"--peer-python {python}: {done.stderr.strip().splitlines()[-1]}; {HOW}")
        if done.returncode != 0 or not answer.is_file():
            said = done.stderr.strip().splitlines()[-1:] or ["no reason given"]
            raise OperatorError(f"{script} by {python}: {said[0]}")
        with np.load(answer) as found:
            return {name: found[name] for name in found.files}


def same_interpreter(python: Path) -> bool:
    """Whether that is the interpreter that runs this."""
    return python.resolve() == Path(sys.executable).resolve()
