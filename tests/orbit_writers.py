"""Orbit files of every format the product reads, written from a known motion; the readers' opposite, for tests only."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

AHEAD_OF_GPS_S = {"GPS": 0.0, "TAI": 19.0, "TT": 51.184, "UTC": -18.0}  # from 2017 to the day of writing
PER_MPS = {"m/s": 1.0, "dm/s": 10.0, "km/s": 1e-3}


def calendar(t_gps_ns: int, scale: str) -> datetime:
    """Reading of a clock of this scale, to the microsecond."""
    return datetime(1980, 1, 6) + timedelta(microseconds=round(t_gps_ns / 1000 + AHEAD_OF_GPS_S[scale] * 1e6))


def save(path: Path, text: str) -> Path:
    """Write text, gzipped if the name says so."""
    with gzip.open(path, "wt", encoding="ascii") if path.suffix == ".gz" else open(path, "w", encoding="ascii") as out:
        out.write(text)
    return path


def sp3(
    t: np.ndarray,
    r_m: np.ndarray,
    v_mps: np.ndarray | None,
    scale: str = "GPS",
    unit: str = "dm/s",
    version: str = "c",
    satellite: str = "L99",
) -> str:
    """SP3 with the habits of real files: blank '++' lines, missing clocks, millimetres and 0.1 micrometres/s."""
    flag = "P" if v_mps is None else "V"
    header = [f"#{version}{flag}2019  1  1  0  0  0.00000000 {len(t):7d} ORBIT ITRF  FIT TEST"]
    header += ["## 2034 172800.00000000    60.00000000", f"+    1   {satellite}  0  0", "++", "++"]
    header += [f"%c L  cc {'ccc' if version == 'a' else scale} ccc cccc", "%c cc cc ccc ccc cccc", "/* TEST"]
    lines = []
    for k, when in enumerate(t):
        moment = calendar(int(when), scale)
        lines.append(f"*  {moment:%Y %m %d %H %M} {moment.second + moment.microsecond * 1e-6:11.8f}")
        lines.append(f"P{satellite}" + "".join(f"{x / 1e3:14.6f}" for x in r_m[k]) + " 999999.999999")
        if v_mps is not None:
            lines.append(f"V{satellite}" + "".join(f"{x * PER_MPS[unit]:14.6f}" for x in v_mps[k]) + " 999999.999999")
    return "\n".join([*header, *lines, "EOF"]) + "\n"


def georb(t: np.ndarray, r_m: np.ndarray, v_mps: np.ndarray, frame: str = "ICRF", jitter_s: float = 2e-7) -> str:
    """GEORB: Terrestrial Time with jitter of its stamps."""
    rng = np.random.default_rng(5)
    lines = [
        "GEORB format file",
        f"Reference Frame  :  {frame} ",
        "Time scale  :  Terrestrial Time ",
        "end_of_header  ",
    ]
    for k, when in enumerate(t):
        days, within_ns = divmod(int(when) + 51_184_000_000, 86_400 * 10**9)
        seconds = within_ns * 1e-9 + jitter_s * rng.uniform(-1.0, 1.0)
        lines.append(f"{days + 44244:9d} {seconds:18.9f}" + "".join(f"{x:26.11f}" for x in (*r_m[k], *v_mps[k])))
    return "\n".join(lines) + "\n"


def eof(t: np.ndarray, r_m: np.ndarray, v_mps: np.ndarray, frame: str = "EARTH_FIXED") -> str:
    """A Sentinel orbit file with TAI, UTC and a UT1 of no worth."""
    lines = ['<?xml version="1.0" ?>', "<Earth_Explorer_File><Earth_Explorer_Header>", "<Mission>Sentinel-1X</Mission>"]
    lines += [f"<Ref_Frame>{frame}</Ref_Frame></Earth_Explorer_Header>", f'<Data_Block><List_of_OSVs count="{len(t)}">']
    for k, when in enumerate(t):
        lines.append("<OSV>")
        lines += [f"<{s}>{s}={calendar(int(when), s).isoformat(timespec='microseconds')}</{s}>" for s in ("TAI", "UTC")]
        lines.append("<UT1>UT1=1999-01-01T00:00:00.000000</UT1>")
        lines += [f'<{n} unit="m">{x:.6f}</{n}>' for n, x in zip("XYZ", r_m[k], strict=True)]
        lines += [f'<V{n} unit="m/s">{x:.6f}</V{n}>' for n, x in zip("XYZ", v_mps[k], strict=True)]
        lines.append("</OSV>")
    return "\n".join([*lines, "</List_of_OSVs></Data_Block></Earth_Explorer_File>"]) + "\n"


def leogps(t: np.ndarray, r_m: np.ndarray, v_mps: np.ndarray) -> str:
    """Rows of d/m/y, time, km, dm/s in GPS time."""
    lines = []
    for k, when in enumerate(t):
        m = calendar(int(when), "GPS")
        values = ",".join(f"{x:.6f}" for x in (*(r_m[k] / 1e3), *(v_mps[k] * 10.0)))
        lines.append(f"{m.day}/{m.month}/{m.year},{m:%H:%M:%S},{values}")
    return "\n".join(lines) + "\n"


def _oem_epoch(t_gps_ns: int, scale: str, day_of_year: bool) -> str:
    moment = calendar(t_gps_ns, scale)
    return moment.strftime("%Y-%jT%H:%M:%S.%f" if day_of_year else "%Y-%m-%dT%H:%M:%S.%f")


def oem_kvn(
    segments: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    frame: str = "ITRF2014",
    scale: str = "UTC",
    version: str = "2.0",
    day_of_year: bool = False,
    **meta: str,
) -> str:
    """An OEM in KVN of segments (t, r_m, v_mps), with comments, covariance and accelerations as the standard allows."""
    lines = [f"CCSDS_OEM_VERS = {version}", "COMMENT made for a test", "CREATION_DATE = 2019-01-01T00:00:00"]
    lines.append("ORIGINATOR = TEST")
    for t, r_m, v_mps in segments:
        start, stop = (_oem_epoch(int(t[k]), scale, day_of_year) for k in (0, -1))
        fields = {"OBJECT_NAME": "TESTSAT", "OBJECT_ID": "2019-001A", "CENTER_NAME": "EARTH", "REF_FRAME": frame}
        fields |= {"TIME_SYSTEM": scale, "START_TIME": start, "STOP_TIME": stop} | meta
        lines += ["", "META_START", *(f"{key:<14} = {value}" for key, value in fields.items()), "META_STOP", ""]
        lines.append("COMMENT position and velocity")
        for k, when in enumerate(t):
            row = "".join(f" {x / 1e3:.9f}" for x in r_m[k]) + "".join(f" {x / 1e3:.12f}" for x in v_mps[k])
            lines.append(_oem_epoch(int(when), scale, day_of_year) + row + (" 0.0 0.0 0.0" if version == "2.0" else ""))
        lines += ["COVARIANCE_START", f"EPOCH = {start}", f"COV_REF_FRAME = {frame}", "1.0", "0.0 1.0"]
        lines.append("COVARIANCE_STOP")
    return "\n".join(lines) + "\n"


def oem_xml(
    segments: list[tuple[np.ndarray, np.ndarray, np.ndarray]], frame: str = "ITRF2014", scale: str = "UTC"
) -> str:
    """The same message in XML (CCSDS 505.0-B)."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<oem id="CCSDS_OEM_VERS" version="2.0">', "<header>"]
    lines += ["<CREATION_DATE>2019-01-01T00:00:00</CREATION_DATE><ORIGINATOR>TEST</ORIGINATOR></header><body>"]
    for t, r_m, v_mps in segments:
        start, stop = (_oem_epoch(int(t[k]), scale, False) for k in (0, -1))
        fields = {"OBJECT_NAME": "TESTSAT", "OBJECT_ID": "2019-001A", "CENTER_NAME": "EARTH", "REF_FRAME": frame}
        fields |= {"TIME_SYSTEM": scale, "START_TIME": start, "STOP_TIME": stop}
        lines += ["<segment><metadata>", *(f"<{key}>{value}</{key}>" for key, value in fields.items()), "</metadata>"]
        lines.append("<data>")
        for k, when in enumerate(t):
            lines.append(f"<stateVector><EPOCH>{_oem_epoch(int(when), scale, False)}</EPOCH>")
            lines += [f'<{n} units="km">{x / 1e3:.9f}</{n}>' for n, x in zip("XYZ", r_m[k], strict=True)]
            lines += [f'<{n}_DOT units="km/s">{x / 1e3:.12f}</{n}_DOT>' for n, x in zip("XYZ", v_mps[k], strict=True)]
            lines.append("</stateVector>")
        lines.append("</data></segment>")
    return "\n".join([*lines, "</body></oem>"]) + "\n"


Writer = Callable[[np.ndarray, np.ndarray, np.ndarray], str]
EARTH_FIXED: dict[str, Writer] = {
    "orbit.sp3": sp3,
    "orbit.orb": lambda t, r, v: georb(t, r, v, "ITRF"),
    "orbit.EOF": eof,
    "orbit.csv": leogps,
    "orbit.oem": lambda t, r, v: oem_kvn([(t, r, v)]),
    "orbit.xml": lambda t, r, v: oem_xml([(t, r, v)]),
}
