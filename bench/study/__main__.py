"""Undeclared effects in simulated devices: are they found? `make study`; `--help` for parts."""

import argparse
from pathlib import Path

from bench.commit import commit
from bench.study import reference
from bench.study.cases import LIMITS, all_cases
from bench.study.devices import PLANS
from bench.study.run import run
from bench.study.tables import document


def main():
    """Run the study, or the part that the options choose, and print or write its document."""
    parser = argparse.ArgumentParser(prog="python -m bench.study", description=__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="devices of each case")
    parser.add_argument("--first", type=int, default=0, help="seed of the first device")
    parser.add_argument("--controls", type=int, default=40, help="controls of each plan")
    parser.add_argument("--effects", help="names, with commas; control, two and outside are names")
    parser.add_argument("--records", help="poses, static_record, motion; reference")
    parser.add_argument("--sensors", help="accelerometer or gyroscope")
    parser.add_argument("--plan", choices=PLANS, default=PLANS[0], help="devices of poses")
    parser.add_argument("--limits", type=float, default=LIMITS, help="size in detection limits")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--write", type=Path, help="file to write instead of printing")
    options = parser.parse_args()
    if options.records == "reference":
        reference.main(options.first, options.seeds, options.workers)
        return
    cases = [
        case
        for case in all_cases(options.plan, options.limits)
        if (not options.records or case.record in options.records.split(","))
        and (not options.sensors or case.sensor in (*options.sensors.split(","), ""))
        and (
            not options.effects
            or {case.kind, "+".join(case.names)} & set(options.effects.split(","))
        )
    ]
    outcomes = run(cases, options.first, options.seeds, options.controls, options.workers)
    text = document(outcomes, "make study", commit(), options.first)
    if options.write:
        options.write.write_text(text)
    else:
        print(text)


if __name__ == "__main__":
    main()
