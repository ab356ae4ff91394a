"""Undeclared effects in simulated devices: are they found? `make study`; `--help` for parts."""

import argparse
from pathlib import Path

from bench.study.cases import LIMITS, all_cases
from bench.study.run import run
from bench.study.tables import document
from bench.tables import publish


def main():
    """Run the study, or the part that the options choose, and write its tables to build/bench."""
    parser = argparse.ArgumentParser(prog="python -m bench.study", description=__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="devices of each case")
    parser.add_argument("--first", type=int, default=0, help="seed of the first device")
    parser.add_argument("--controls", type=int, default=40, help="controls of each plan")
    parser.add_argument("--effects", help="names, or kinds of cases, with commas")
    parser.add_argument("--limits", type=float, default=LIMITS, help="size in detection limits")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--keep", type=Path, help="folder of a file per outcome: goes on with it")
    options = parser.parse_args()
    how = {"workers": options.workers, "keep": options.keep}
    cases = [
        case
        for case in all_cases(options.limits)
        if not options.effects
        or {case.kind, "+".join(case.names)} & set(options.effects.split(","))
    ]
    by_case = run(cases, options.first, options.seeds, options.controls, **how)
    made_of = ", ".join(sorted({d["commit"] for devices in by_case.values() for d in devices}))
    publish("study", "Simulated study of the diagnosis", document(by_case, options.first), made_of)


if __name__ == "__main__":
    main()
