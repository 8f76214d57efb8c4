"""One door to all orbit files: the format is known by the content, then by the name."""

from __future__ import annotations

from pathlib import Path

from hil_sim.errors import DataError
from hil_sim.truth.orbit_files import ccsds_oem, georb, leogps, sentinel_eof, sp3
from hil_sim.truth.orbit_files.text import SCALES, FileSamples, read_text
from hil_sim.truth.real_orbit import RealOrbit, finish

_BY_SUFFIX = {"sp3": "SP3", "eph": "SP3", "orb": "GEORB", "eof": "EOF", "oem": "OEM", "csv": "LEOGPS"}
KNOWN = "SP3 (.sp3), GEORB (.orb), Sentinel (.EOF), CCSDS OEM (.oem, KVN or XML), LEOGPS (.csv), also with .gz"


def read_orbit(
    path: Path, satellite: str | None = None, velocity_unit: str = "auto", time_scale: str | None = None
) -> RealOrbit:
    """The orbit of one satellite of a file.

    satellite: its identifier in the file, needed where there are several. velocity_unit: 'auto' to find out from the
    positions, 'm/s', 'dm/s', 'km/s', or 'derive' to leave those of the file out. time_scale: 'GPS', 'UTC', 'TAI', 'TT'
    instead of what the file says. Raises DataError with file, line and remedy.
    """
    if time_scale is not None:
        time_scale = time_scale.upper()
        if time_scale not in SCALES:
            raise DataError(f"{path}: time scale {time_scale}: one of {', '.join(SCALES)}")
    return finish(path, _samples(path, _kind(path), satellite, time_scale), velocity_unit)


def _samples(path: Path, kind: str, satellite: str | None, time_scale: str | None) -> FileSamples:
    if kind == "SP3":
        return sp3.samples(sp3.read_sp3(path, time_scale), satellite)
    if kind == "OEM":
        return ccsds_oem.samples(path, satellite, time_scale)
    if kind == "EOF":
        found = sentinel_eof.samples(path, time_scale)
    else:
        found = georb.samples(path) if kind == "GEORB" else leogps.samples(path)
        found = found if time_scale is None else found._replace(scale=time_scale)
    if satellite is not None and found.satellite and satellite != found.satellite:
        raise DataError(f"{path}: no satellite {satellite!r}; it holds {found.satellite}")
    return found


def _kind(path: Path) -> str:
    if not path.is_file():
        raise DataError(f"{path}: no such orbit file")
    text = read_text(path)
    if sp3.is_sp3(text):
        return "SP3"
    if georb.is_georb(text):
        return "GEORB"
    if ccsds_oem.is_oem(text):
        return "OEM"
    if leogps.is_leogps(text):
        return "LEOGPS"
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        head = text[:4000]
        if "Earth_Explorer" in head:
            return "EOF"
        if "<oem" in head or ":oem" in head or "<ndm" in head:
            return "OEM"
    suffix = path.name.removesuffix(".gz").rpartition(".")[2].lower()
    if suffix not in _BY_SUFFIX:
        raise DataError(f"{path}: unknown kind of orbit file; known are {KNOWN}")
    return _BY_SUFFIX[suffix]
