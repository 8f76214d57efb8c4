"""What a user installs: the wheel in an empty environment that nothing may write to, run from somewhere else."""

from __future__ import annotations

import json
import os
import shutil
import stat
import subprocess
import sys
import venv
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

from flightsw.kernels.kernel_cache import cache_folder

ROOT = Path(__file__).resolve().parents[2]
COLD = "LEONAV_COLD" in os.environ  # make test-long: the run compiles every kernel itself
SOURCES = ("flightsw", "ground", "hil_sim", "pyproject.toml", "README.md", "LICENSE")
SHORT_RUN = ("time.duration_s=300", "outage.0.start_s=120", "outage.0.duration_s=60")
LEFT_BY_A_RUN = (
    "summary.json",
    "run.json",
    "timing.json",
    "can.log",
    "link.tlog",
    "truth.npz",
    "monitor.npz",
    "tables/navigation.tbl",
    "tables/earth_orientation.tbl",
    "figures/0_overview.png",
)


# What is compiled where no kernels are found: one entry, as a run would compile all of them.
COMPILE = """
from flightsw.kernels import geodetic, registry
registry.warm_up()
assert geodetic.geodetic.stats.cache_misses
"""


def _pip(*arguments: str, python: str = sys.executable) -> subprocess.CompletedProcess[str]:
    return subprocess.run([python, "-m", "pip", *arguments], capture_output=True, text=True, timeout=900)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project's wheel, built from a copy of its sources; skips where no package index can be reached."""
    folder = tmp_path_factory.mktemp("wheel")
    probe = _pip("download", "--quiet", "--no-deps", "--dest", str(folder / "probe"), "setuptools>=77")
    if probe.returncode != 0:
        pytest.skip(
            f"no package index can be reached: {(probe.stderr.strip().splitlines() or ['no reason given'])[-1]}"
        )
    copy = folder / "copy"
    copy.mkdir()
    for name in SOURCES:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(source, copy / name)
    built = _pip("wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder / "dist"), str(copy))
    assert built.returncode == 0, built.stderr
    (path,) = (folder / "dist").glob("leonav-*.whl")
    return path


def test_the_wheel_holds_the_three_packages_and_their_data(wheel: Path) -> None:
    """GIVEN the wheel WHEN it is opened THEN the sources and data of the three packages are in it, no more."""
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if ".dist-info/" not in name}
    suffixes = {".py", ".dbc", ".xml", ".toml", ".tbl", ".json", ".html", ".c"}
    wanted = {
        path.relative_to(ROOT).as_posix()
        for package in ("flightsw", "ground", "hil_sim")
        for path in (ROOT / package).rglob("*")
        if path.suffix in suffixes
    }
    assert packed == wanted


def test_the_wheel_says_what_it_is(wheel: Path) -> None:
    """GIVEN the wheel WHEN its metadata are read THEN base, extras, licence and commands are those of the project."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = Parser().parsestr(archive.read(name).decode())
        scripts = archive.read(name.replace("METADATA", "entry_points.txt")).decode()
    required = metadata.get_all("Requires-Dist") or []
    base = {line for line in required if "extra ==" not in line}
    assert base == {"numpy", "numba", "python-can", "pymavlink"}
    assert set(metadata.get_all("Provides-Extra") or []) == {
        "sim",
        "ground",
        "cluster",
        "rinex",
        "mcap",
        "web",
        "dev",
    }
    assert metadata["License-Expression"] == "Apache-2.0"
    assert {line.partition(" =")[0] for line in scripts.splitlines() if "=" in line} == {
        "flightsw",
        "ground",
        "hil_sim",
    }


def _snapshot(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and time of last change of every file: where the tests run as root, permissions alone may stop nothing.

    Left out is satkit's note that it has verified its own data; it makes one where it may write.
    """
    return {
        path.relative_to(folder).as_posix(): (path.lstat().st_size, path.lstat().st_mtime_ns)
        for path in folder.rglob("*")
        if path.is_file() and not path.is_symlink() and path.suffix != ".sha256-verified"
    }


def _bound_by_permissions() -> list[str]:
    """What to put before a command so that permissions bind it: root goes without its right to ignore them."""
    if os.name != "posix" or os.geteuid() != 0 or shutil.which("setpriv") is None:
        return []
    return ["setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-all"]


def _make_read_only(folder: Path) -> None:
    for path in [folder, *folder.rglob("*")]:
        if not path.is_symlink():
            path.chmod(path.stat().st_mode & ~(stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH))


@pytest.mark.slow
def test_a_run_from_an_empty_read_only_environment(wheel: Path, tmp_path: Path) -> None:
    """GIVEN the wheel with extras sim and ground in an empty environment that may not be written
    WHEN a kernel is compiled and `hil_sim run nominal` called from an empty folder, with an empty home
    THEN both end with status 0, the run leaves its files, and nothing is changed but its output and the caches.

    The kernels of the run are those of this tree, which are the same to the byte: the wheel is built from its sources.
    """
    environment, home, elsewhere, out = (tmp_path / name for name in ("env", "home", "elsewhere", "out"))
    venv.create(environment, with_pip=True)
    python = str(environment / "bin" / "python")
    constraints = str(ROOT / "constraints.txt")
    # Without byte code: the interpreter will want to write it into the environment, and must do without.
    installed = _pip("install", "--quiet", "--no-compile", "-c", constraints, f"{wheel}[sim,ground]", python=python)
    assert installed.returncode == 0, installed.stderr
    home.mkdir()
    elsewhere.mkdir()
    _make_read_only(environment)
    before = _snapshot(environment)
    outside = {
        "HOME": str(home),
        "XDG_CACHE_HOME": str(home / ".cache"),
        "PATH": f"{environment / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "LANG": "C.UTF-8",
    }
    kernels = {} if COLD else {"LEONAV_CACHE_DIR": str(cache_folder().parents[1])}
    confined = _bound_by_permissions()
    overrides = [word for key in SHORT_RUN for word in ("--set", key)]

    def call(*command: str | Path, **more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*confined, *command],
            cwd=elsewhere,
            env=outside | more,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=600,
        )

    try:
        compiled = call(python, "-c", COMPILE)
        flown = call(environment / "bin" / "hil_sim", "run", "nominal", "--out", out, *overrides, **kernels)
        exported = call(environment / "bin" / "ground", "icd", "export", tmp_path / "icd")
        after = _snapshot(environment)
    finally:
        for path in environment.rglob("*"):  # so that pytest may remove it
            if path.is_dir() and not path.is_symlink():
                path.chmod(0o755)
        environment.chmod(0o755)
    assert compiled.returncode == 0, compiled.stderr
    assert [*(home / ".cache" / "leonav").rglob("*.nbc")] != []
    assert flown.returncode == 0, flown.stderr
    assert "VERDICT" in flown.stdout
    assert [name for name in LEFT_BY_A_RUN if not (out / name).is_file()] == []
    assert json.loads((out / "summary.json").read_text())["scenario"] == "nominal"
    assert exported.returncode == 0, exported.stderr
    assert {path.suffix for path in (tmp_path / "icd").iterdir()} >= {".dbc", ".xml", ".py"}
    assert after == before
    assert list(elsewhere.iterdir()) == []
    assert {path.name for path in home.iterdir()} <= {".cache", ".config"}


def test_a_change_of_the_environment_is_seen(tmp_path: Path) -> None:
    """GIVEN a folder without write permission WHEN something is added to or changed in it THEN the snapshot tells."""
    (tmp_path / "a").write_text("1")
    _make_read_only(tmp_path)
    before = _snapshot(tmp_path)
    assert _snapshot(tmp_path) == before
    (tmp_path / "a").chmod(0o644)
    (tmp_path / "a").write_text("22")
    assert _snapshot(tmp_path) != before
    tmp_path.chmod(0o755)
