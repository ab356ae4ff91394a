"""Make, diagnose and judge devices on several processes."""

import multiprocessing
import time
from dataclasses import asdict

from bench.study.cases import injected
from bench.study.chain import base_pulls, diagnosis_of, likeness
from bench.study.devices import DEVICES, in_shape, with_effects
from bench.study.score import fitted


def run(cases, first, seeds, controls, workers, progress=print):
    """Return the outcomes of cases, by case.

    Parameters
    ----------
    cases : sequence of Case
        Cases of one plan; controls are made for the records of the others too.
    first : int
        Seed of the first device.
    seeds, controls : int
        Devices of each case, and controls of each record.
    workers : int
        Processes.
    progress : callable
        Takes a line of text.

    Returns
    -------
    dict of Case to list of dict
        Of each device: ``seed``, ``seconds``, ``diagnosis``, and but for controls ``control``,
        ``injected`` and ``found``; ``None`` for the diagnosis where the log cannot show the effect.
        ``base_pulls`` of those that have a diagnosis.
    """
    with multiprocessing.get_context("fork").Pool(workers) as pool:
        plain = {}
        (plan,) = {case.plan for case in cases}
        # limits size what is put into a device: other controls go without
        jobs = [
            (record, plan, seed, seed < first + seeds)
            for record in sorted({case.record for case in cases})
            for seed in range(
                first,
                first
                + max(
                    seeds, controls * ((record, "control") in {(c.record, c.kind) for c in cases})
                ),
            )
        ]
        for (record, _, seed, _), made in pool.imap(_control, jobs):
            plain[record, seed] = made
            progress(f"control {record} {seed}: {made['seconds']:.1f} s")
        jobs = [
            (case, seed, plain[case.record, seed])
            for case in cases
            if case.kind != "control"
            for seed in range(first, first + seeds)
        ]
        outcomes = {
            case: [plain[case.record, first + k] for k in range(controls)]
            for case in cases
            if case.kind == "control"
        }
        for case, made in pool.imap(_device, jobs):
            outcomes.setdefault(case, []).append(made)
            progress(f"{case.record} {case.sensor} {' + '.join(case.names)} {made['seed']}")
    return outcomes


def _control(job):
    record, plan, seed, limits = job
    start = time.process_time()

    def also(*device):
        return likeness(*device), base_pulls(*device)

    diagnosis, (alike, pulls) = diagnosis_of(DEVICES[record](plan), seed, also, limits)
    took = time.process_time() - start
    made = {"seed": seed, "seconds": took, "diagnosis": diagnosis}
    return job, made | {"likeness": alike, "base_pulls": pulls}


def _device(job):
    case, seed, control = job
    start = time.process_time()
    effects = injected(case, seed, control)
    made = {
        "seed": seed,
        "control": control["diagnosis"],
        "diagnosis": None,
        "injected": [],
        "found": [],
    }
    if effects is not None:
        truth = with_effects(DEVICES[case.record](case.plan), effects)
        diagnosis, made["base_pulls"] = diagnosis_of(truth, seed, base_pulls, limits=False)
        made["diagnosis"] = diagnosis
        made["injected"] = [
            {k: v for k, v in asdict(e).items() if k not in ("extra", "noise")} for e in effects
        ]
        made["found"] = [
            {**found, "expected": in_shape(truth, seed, effect, found, record)}
            for effect in effects
            for record, found in fitted(diagnosis, case.sensor, case.record, effect.name)
        ]
    made["seconds"] = time.process_time() - start
    return case, made
