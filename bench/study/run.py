"""Make, diagnose and judge devices on several processes."""

import multiprocessing
import time
from dataclasses import asdict

from bench.study.cases import choose_effects
from bench.study.chain import base_pulls, diagnosis_of, likeness
from bench.study.devices import DEVICES, with_effects
from bench.study.keep import keep_outcome
from bench.study.score import effect_entries
from bench.tables import commit


def run(cases, first, seeds, controls, workers, keep=None, progress=print):
    """Return the outcomes of cases, a list by case; controls are made for all records.

    `seeds` devices of each case and `controls` of each record, from the seed `first` on. A device
    has: ``seed``, ``seconds``, ``commit``, ``diagnosis`` (None where the log cannot show the
    effect) with ``base_pulls``, and but for controls ``control``, ``injected`` and ``found``.
    Each is written into the folder `keep` when it is made, and read if it is there.
    """
    plain, outcomes, made_of = {}, {}, commit()
    asked = [case.record for case in cases if case.kind == "control"]
    # limits size the effects put into a device: other controls go without
    jobs = [
        (keep, made_of, record, first + k, k < seeds)
        for record in sorted({case.record for case in cases})
        for k in range(max(seeds, controls * (record in asked)))
    ]
    with multiprocessing.get_context("fork").Pool(workers) as pool:
        for (*_, record, seed, _), outcome in pool.imap(_control, jobs):
            plain[record, seed] = outcome
            progress(f"control {record} {seed}: {outcome['seconds']:.1f} s")
        for case in cases:
            if case.kind == "control":
                outcomes[case] = [plain[case.record, first + k] for k in range(controls)]
        jobs = [
            (keep, made_of, case, seed, plain[case.record, seed])
            for case in cases
            if case.kind != "control"
            for seed in range(first, first + seeds)
        ]
        for case, outcome in pool.imap(_device, jobs):
            outcomes.setdefault(case, []).append(outcome)
            progress(f"{case.record} {case.sensor} {' + '.join(case.names)} {outcome['seed']}")
    return outcomes


def _control(job):
    keep, made_of, record, seed, limits = job
    name = f"control_{record}_{seed}" + ("" if limits else "_without_limits")
    return job, keep_outcome(keep, name, made_control, record, seed, limits, made_of)


def made_control(record, seed, limits, made_of):
    """Return the outcome of a device without effects."""
    start = time.process_time()

    def also(*device):
        return {"likeness": likeness(*device), "base_pulls": base_pulls(*device, seed)}

    moving = record == "motion"
    diagnosis, more = diagnosis_of(DEVICES[record](), seed, also, limits, moving)
    seconds = time.process_time() - start
    return {"seed": seed, "seconds": seconds, "commit": made_of, "diagnosis": diagnosis, **more}


def _device(job):
    keep, made_of, case, seed, control = job
    words = (case.kind, case.record, case.sensor, *case.names, f"{case.limits:g}")
    name = "_".join((*words, str(seed)))
    return case, keep_outcome(keep, name, made_device, case, seed, control, made_of)


def made_device(case, seed, control, made_of):
    """Return the outcome of a device of a case, sized by its control."""
    start, effects = time.process_time(), choose_effects(case, seed, control)
    outcome = {"seed": seed, "commit": made_of, "control": control["diagnosis"], "diagnosis": None}
    outcome |= {"injected": [], "found": []}
    if effects is not None:
        truth = with_effects(DEVICES[case.record](), effects)
        moving = case.record == "motion"

        def also(*device):
            return base_pulls(*device, seed)

        diagnosis, errors = diagnosis_of(truth, seed, also, limits=False, motion=moving)
        outcome |= {"diagnosis": diagnosis, "base_pulls": errors}
        outcome["injected"] = [
            {k: v for k, v in asdict(e).items() if k not in ("extra", "noise")} for e in effects
        ]
        outcome["found"] = [
            # between two of the time constants that are tried, no parameter is the one put in
            {**entry, "expected": effect.values if entry["constants"] == effect.constants else {}}
            for effect in effects
            for record, entry in effect_entries(
                outcome["diagnosis"], case.sensor, case.record, effect.name
            )
        ]
    return outcome | {"seconds": time.process_time() - start}
