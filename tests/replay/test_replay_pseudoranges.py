"""Pseudoranges in the journal: flown again they give the same verdicts, fixes and bytes."""

import json
from pathlib import Path

from gnss_bench import checks
from harness import Flight, fault, faults, load, save_run

from flightsw import replay


def test_a_flight_on_pseudoranges_replays_byte_for_byte(tmp_path: Path) -> None:
    """GIVEN pseudoranges with faulty satellites, lost and damaged frames, an outage WHEN the journal is flown again
    THEN the same bytes go out; with another table of the test it says that the run had another.
    """
    wrong = '{kind="step", constellation="gps", count=2, start_s=30.0, duration_s=20.0, value=50.0}'
    bad = faults(
        fault("frame_drop", 20, 20, probability=0.05),
        fault("bit_flip", 40, 20, probability=0.1, target="ranges"),
        fault("frame_drop", 20, 40, probability=0.2, target="ephemeris"),
    )
    loaded = load(f"satellite_fault=[{wrong}]", bad, "outage=[{start_s=50.0, duration_s=3.0}]", name="gnss_faults")
    with Flight(loaded, tmp_path) as flight:
        flight.fly()
    assert checks(flight)["offered"].sum() >= 20
    save_run(flight, tmp_path)
    record = json.loads((tmp_path / "run.json").read_text())
    assert replay.check_versions(tmp_path) == []
    assert replay.replay(tmp_path, tmp_path / "again") == (600, None, None)
    record["tables"]["gnss"]["crc32"] ^= 1
    (tmp_path / "run.json").write_text(json.dumps(record))
    assert any("gnss" in text for text in replay.check_versions(tmp_path))
