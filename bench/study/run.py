"""Make, diagnose and judge devices on several processes."""

import multiprocessing
import time
from dataclasses import asdict

from bench.study.cases import injected
from bench.study.chain import base_pulls, diagnosis_of, likeness
from bench.study.devices import DEVICES, in_shape, with_effects
from bench.study.score import fitted


def run(cases, first, seeds, controls, workers, progress=print):
    """Return the outcomes of cases of one plan, a list by case; controls are made for all records.

    `seeds` devices of each case and `controls` of each record, from the seed `first` on. Of each
    device: ``seed``, ``seconds``, ``diagnosis`` (None where the log cannot show the effect) with
    ``base_pulls``, and but for controls ``control``, ``injected`` and ``found``.
    """
    (plan,), plain, outcomes = {case.plan for case in cases}, {}, {}
    asked = [case.record for case in cases if case.kind == "control"]
    # limits size what is put into a device: other controls go without
    jobs = [
        (record, plan, first + k, k < seeds)
        for record in sorted({case.record for case in cases})
        for k in range(max(seeds, controls * (record in asked)))
    ]
    with multiprocessing.get_context("fork").Pool(workers) as pool:
        for (record, _, seed, _), made in pool.imap(_control, jobs):
            plain[record, seed] = made
            progress(f"control {record} {seed}: {made['seconds']:.1f} s")
        for case in cases:
            if case.kind == "control":
                outcomes[case] = [plain[case.record, first + k] for k in range(controls)]
        jobs = [
            (case, seed, plain[case.record, seed])
            for case in cases
            if case.kind != "control"
            for seed in range(first, first + seeds)
        ]
        for case, made in pool.imap(_device, jobs):
            outcomes.setdefault(case, []).append(made)
            progress(f"{case.record} {case.sensor} {' + '.join(case.names)} {made['seed']}")
    return outcomes


def _control(job):
    record, plan, seed, limits = job
    start = time.process_time()

    def also(*device):
        return {"likeness": likeness(*device), "base_pulls": base_pulls(*device)}

    moving = record == "motion"
    diagnosis, more = diagnosis_of(DEVICES[record](plan), seed, also, limits, moving)
    seconds = time.process_time() - start
    return job, {"seed": seed, "seconds": seconds, "diagnosis": diagnosis, **more}


def _device(job):
    case, seed, control = job
    start, effects = time.process_time(), injected(case, seed, control)
    made = {"seed": seed, "control": control["diagnosis"], "diagnosis": None}
    made |= {"injected": [], "found": []}
    if effects is not None:
        truth = with_effects(DEVICES[case.record](case.plan), effects)
        moving = case.record == "motion"
        found = diagnosis_of(truth, seed, base_pulls, limits=False, motion=moving)
        made["diagnosis"], made["base_pulls"] = found
        made["injected"] = [
            {k: v for k, v in asdict(e).items() if k not in ("extra", "noise")} for e in effects
        ]
        made["found"] = [
            {**found, "expected": in_shape(truth, seed, effect, found, record)}
            for effect in effects
            for record, found in fitted(made["diagnosis"], case.sensor, case.record, effect.name)
        ]
    return case, made | {"seconds": time.process_time() - start}
