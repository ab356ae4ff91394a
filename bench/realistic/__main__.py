"""Realistic devices, imuloop against a plain fit. A line of JSON per device, and a summary."""

import argparse
import json
import multiprocessing
import sys
from itertools import product
from pathlib import Path

import numpy as np

from bench.realistic.device import CASES
from bench.realistic.judge import SENSORS, alarms, judge
from bench.tables import commit, share, table

# ratio of the errors above which a device is named
WORSE = 1.5


def name(device):
    """Return the name of a device."""
    return f"{device['case']}_{device['seed']}"


def summary(devices):
    """Return the tables of devices, as `judge.outcome` gives them."""
    free = [d for d in devices if d["effect_free"]]
    groups = {case: [d for d in devices if d["case"] == case] for case in CASES}
    groups |= {"effect-free": free, "every": devices}
    header = (
        "case", "devices", "accelerometer: median", "90th", "gyroscope: median", "90th",
        f"above {WORSE}", "false alarms", "s",
    )  # fmt: skip
    alarmed = [d for d in free if alarms(d)]
    lines = [f"- {name(d)}: {'; '.join(alarms(d))}" for d in alarmed]
    lines += [f"- {name(d)}: {odd}" for d in devices for odd in oddities(d)]
    return "\n\n".join(
        [
            "Error of imuloop over the error of the plain fit; seconds are of one processor.",
            table(header, [row(case, group) for case, group in groups.items() if group]),
            f"False alarms: {share(len(alarmed), len(free))}.",
            "\n".join(lines),
            "95 % intervals of effect-free devices that hold the truth.",
            table(("sensor", "T", "K", "b"), [(s, *coverage(free, s)) for s in SENSORS]),
        ]
    )


def row(case, devices):
    """Return the row of some devices in the table; devices of one case are named after it."""
    figures, worse = [], []
    for s in SENSORS:
        ratios = {name(d): d["ratios"][s] for d in devices if d["ratios"][s] is not None}
        figures += np.percentile(list(ratios.values()) or [np.nan], (50, 90)).tolist()
        worse += [f"{n} {s[0]} {r:.2f}" for n, r in ratios.items() if r > WORSE]
    false = sum(d["effect_free"] and bool(alarms(d)) for d in devices)
    seconds = np.mean([d["seconds"] for d in devices])
    named = ", ".join(worse) or "–" if case in CASES else len(worse)
    return case, len(devices), *(f"{x:.2f}" for x in figures), named, false, f"{seconds:.0f}"


def coverage(devices, sensor):
    """Return the shares of T, K and b, as text, that lie within 1.96 of their standard errors."""
    pulls = [pull for d in devices for pull in d["pulls"][sensor].items()]
    kinds = ([abs(v) <= 1.96 for n, v in pulls if n[0] == kind] for kind in "TKb")
    return [share(sum(inside), len(inside)) for inside in kinds]


def oddities(device):
    """Return failures, and a line for each sensor that one of the two fits did not give."""
    lines = [*device["failures"]]
    for s, method in device["methods"].items():
        if method != "multi_position":
            lines.append(f"{s} by imuloop: {method}, {device['not_testable'][s]}")
    return lines + [f"{s}: no plain fit" for s in device["no_plain_fit"]]


def main():
    """Judge devices, append them to a file, and print the summary of all in it."""
    parser = argparse.ArgumentParser(prog="python -m bench.realistic", description=__doc__)
    parser.add_argument("--first", type=int, default=0, help="seed of the first device")
    parser.add_argument("--seeds", type=int, default=1, help="devices of each case")
    parser.add_argument("--cases", default=",".join(CASES), help="names, with commas")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    lines = "file of a line per device; those in it are not judged again"
    parser.add_argument("--lines", type=Path, default=Path("build/realistic.jsonl"), help=lines)
    parser.add_argument("--keep", type=Path, help="folder in which logs and results are kept")
    options = parser.parse_args()
    cases = options.cases.split(",")
    if unknown := set(cases) - {*CASES}:
        parser.error(f"{min(unknown)} is not a case; choose from {', '.join(CASES)}")
    options.lines.parent.mkdir(parents=True, exist_ok=True)
    options.lines.touch()
    devices = [json.loads(line) for line in options.lines.read_text().splitlines()]
    done = {(d["seed"], d["case"]) for d in devices}
    seeds, made_of = range(options.first, options.first + options.seeds), commit()
    jobs = [(*job, options.keep) for job in product(seeds, cases) if job not in done]
    with multiprocessing.Pool(options.workers) as pool, options.lines.open("a") as file:
        for job in [pool.apply_async(judge, job) for job in jobs]:
            devices.append(job.get() | {"commit": made_of})
            print(json.dumps(devices[-1]), file=file, flush=True)
            ratios = ", ".join(f"{s} {r or np.nan:.2f}" for s, r in devices[-1]["ratios"].items())
            print(f"{name(devices[-1])}: {ratios}", *alarms(devices[-1]), sep="; ", file=sys.stderr)
    print(summary(devices))


if __name__ == "__main__":
    main()
