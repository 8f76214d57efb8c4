"""What flew: code, tables, versions. A replay may expect the same bytes only where all of it is the same."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
from pathlib import Path
from typing import Any

from flightsw.checkpoint import Resume
from flightsw.icd.table_file import TableImage
from flightsw.kernels.kernel_cache import source_hash

LIBRARIES = ("numpy", "numba", "llvmlite", "python-can", "pymavlink")
_PACKAGE = Path(__file__).resolve().parent


def package_hash() -> str:
    """SHA-256 over every Python source of flight, compiled or not."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        digest.update(path.relative_to(_PACKAGE).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def identity(
    navigation: TableImage,
    orientation: TableImage,
    *others: TableImage,
    resume: Resume | None = None,
    allow_saturating: bool = False,
) -> dict[str, Any]:
    """The part of run.json that decides what flight does with a journal.

    others: the force tables, if they fly. resume: the checkpoint it began with, if it did.
    allow_saturating: it was told to fly a bound that settles below its limit.
    """
    return {
        "flight_source_sha256": source_hash(),
        "flight_package_sha256": package_hash(),
        "checkpoint": None if resume is None else {"sha256": resume.image_sha256, "max_age_s": resume.max_age_s},
        "allow_saturating": allow_saturating,
        "tables": {
            "navigation": {"set": navigation.set_name, "crc32": navigation.crc32},
            "earth_orientation": {"crc32": orientation.crc32},
            **{table.kind: {"crc32": table.crc32} for table in others},
        },
        "versions": {
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in LIBRARIES},
        },
        "machine": platform.machine(),
    }


def differences(run: dict[str, Any], here: dict[str, Any]) -> list[str]:
    """What differs between the flight of a run and the one here, in words; both as `identity` gives them."""
    found = []
    for key, what in (
        ("flight_source_sha256", "the compiled flight code is not that of the run"),
        ("flight_package_sha256", "the flight code outside the kernels is not that of the run"),
    ):
        if run.get(key) != here[key]:
            found.append(what)
            break  # the package holds the kernels: one sentence is enough
    for name, table in here["tables"].items():
        flew = _part(run, "tables", name).get("crc32")
        if flew != table["crc32"]:
            text = f"CRC {flew:08x}" if isinstance(flew, int) else "none that run.json names"
            found.append(f"table {name} has CRC {table['crc32']:08x}, the run flew {text}")
    if run.get("checkpoint") != here["checkpoint"]:
        began = _part(run, "checkpoint").get("sha256")
        text = f"with checkpoint {str(began)[:16]}" if began else "without a checkpoint"
        found.append(f"the checkpoint here is not that of the run, which began {text}")
    for name, version in here["versions"].items():
        flew = _part(run, "versions").get(name)
        if flew != version:
            found.append(f"{name} is {version}, the run flew with {flew or 'an unknown version'}")
    if run.get("machine") != here["machine"]:
        found.append(f"this machine is {here['machine']}, the run flew on {run.get('machine') or 'an unknown one'}")
    return found


def _part(run: dict[str, Any], *keys: str) -> dict[str, Any]:
    node: Any = run
    for key in keys:
        node = node.get(key) if isinstance(node, dict) else None
    return node if isinstance(node, dict) else {}
