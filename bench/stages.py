"""Time each stage on one simulated device: `make bench`, or with a length in s as argument."""

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from imuloop.calibrate.calibrate import calibrate_device
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.samples import read_samples
from imuloop.core.segments import read_segments, write_segments
from imuloop.diagnose.diagnose import diagnose_device
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.ingest.ingest import ingest
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import Session
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session, write_log
from imuloop.simulate.truth import example_truth


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("duration", nargs="?", type=float, default=1800.0, help="static session, s")
    duration = parser.parse_args().duration
    truth = example_truth()
    static = replace(truth.sessions["static"], duration_s=duration)
    truth = replace(truth, sessions={**truth.sessions, "static": static})
    print(f"{'stage':<10} {'session':<15} {'rows':>9} {'s':>8} {'rows/s':>12}")
    with tempfile.TemporaryDirectory() as folder:
        run(truth, Path(folder))


def timed(stage, session, rows, work):
    """Run `work`, print how long it took, return its result."""
    start = time.perf_counter()
    result = work()
    took = time.perf_counter() - start
    print(f"{stage:<10} {session:<15} {rows:>9} {took:>8.2f} {rows / took:>12.0f}", flush=True)
    return result


def run(truth, folder):
    """Take a device's sessions through every stage from its CSV logs on."""
    sessions, rows = {}, {}
    for name, plan in truth.sessions.items():
        files = {key: folder / f"{name}.{key}" for key in ("csv", "samples", "segments", "json")}
        log = simulate_session(truth, name)
        rows[name] = len(log)
        write_log(files["csv"], log, {})
        sessions[name] = {"kind": plan.kind, **files}
    total = sum(rows.values())
    for name, files in sessions.items():
        timed("ingest", name, rows[name], lambda n=name, f=files: ingest_log(n, f))
    for name, files in sessions.items():
        timed("segment", name, rows[name], lambda f=files: segment_log(f))

    paths = {
        name: folder / f"{name}.json"
        for name in ("noise", "six_position", "multi_position", "diagnosis", "calibration")
    }
    read = [
        Session(name, s["kind"], read_samples(s["samples"]), read_segments(s["segments"]))
        for name, s in sessions.items()
        if s["kind"] == "static"
    ]
    result = timed(
        "noise", "static", rows["static"], lambda: estimate_noise(truth.name, read, NoiseSettings())
    )
    result.to_json(paths["noise"])
    common = {
        "device": truth.name,
        "gravity": truth.gravity,
        "sessions": sessions,
        "noise": paths["noise"],
    }
    timed(
        "calibrate",
        "all",
        total,
        lambda: calibrate_device(
            **common,
            settings=CalibrateSettings(),
            six_path=paths["six_position"],
            multi_path=paths["multi_position"],
        ),
    )
    timed(
        "diagnose",
        "all",
        total,
        lambda: diagnose_device(
            **common,
            six_position=paths["six_position"],
            multi_position=paths["multi_position"],
            calibrate_settings=CalibrateSettings(),
            settings=DiagnoseSettings(),
            diagnosis_path=paths["diagnosis"],
            calibration_path=paths["calibration"],
        ),
    )


def ingest_log(name, files):
    """Ingest one CSV log."""
    ingest(
        device="bench",
        session=name,
        kind=files["kind"],
        paths=[files["csv"]],
        samples_path=files["samples"],
        quality_path=files["json"],
    )


def segment_log(files):
    """Segment one session."""
    samples = read_samples(files["samples"])
    write_segments(files["segments"], *segment_session(samples, files["kind"], SegmentSettings()))


if __name__ == "__main__":
    main()
