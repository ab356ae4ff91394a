"""Make, diagnose and judge devices on several processes."""

import multiprocessing
import time
from dataclasses import asdict

from bench.study.cases import choose_effects
from bench.study.chain import (
    alike_products,
    base_pulls,
    diagnosis_of,
    likeness,
    product_limits,
)
from bench.study.devices import DEVICES, in_variant, with_effects
from bench.study.keep import keep_outcome
from bench.study.score import effect_entries, is_true
from bench.tables import commit


def run(cases, first, seeds, controls, workers, keep=None, make=True, progress=print):
    """Return the outcomes of cases of one plan, a list by case; controls are made for all records.

    `seeds` devices of each case and `controls` of each record, from the seed `first` on. A device
    has: ``seed``, ``seconds``, ``commit``, ``diagnosis`` (None where the log cannot show the
    effect) with ``base_pulls``, and but for controls ``control``, ``injected`` and ``found``.
    Each is written into the folder `keep` when it is made, and read if it is there; unless `make`
    those that are not are left out.
    """
    (plan,), plain, outcomes, made_of = {case.plan for case in cases}, {}, {}, commit()
    asked = [case.record for case in cases if case.kind == "control"]
    # limits size the effects put into a device: other controls go without
    jobs = [
        (keep, make, made_of, record, plan, first + k, k < seeds)
        for record in sorted({case.record for case in cases})
        for k in range(max(seeds, controls * (record in asked)))
    ]
    with multiprocessing.get_context("fork").Pool(workers) as pool:
        for (*_, record, _, seed, _), made in pool.imap(_control, jobs):
            if made:
                plain[record, seed] = made
                progress(f"control {record} {seed}: {made['seconds']:.1f} s")
        for case in cases:
            if case.kind == "control":
                each = (plain.get((case.record, first + k)) for k in range(controls))
                outcomes[case] = [made for made in each if made]
        jobs = [
            (keep, make, made_of, case, seed, plain.get((case.record, seed)))
            for case in cases
            if case.kind != "control"
            for seed in range(first, first + seeds)
        ]
        for case, made in pool.imap(_device, jobs):
            outcomes.setdefault(case, [])
            if made:
                outcomes[case].append(made)
                progress(f"{case.record} {case.sensor} {' + '.join(case.names)} {made['seed']}")
    return {case: made for case, made in outcomes.items() if made}


def _control(job):
    keep, make, made_of, record, plan, seed, limits = job
    name = f"control_{record}_{plan}_{seed}" + ("" if limits else "_without_limits")
    make = made_control if make else None
    return job, keep_outcome(keep, name, make, record, plan, seed, limits, made_of)


def made_control(record, plan, seed, limits, made_of):
    """Return the outcome of a device without effects."""
    start = time.process_time()

    def also(*device):
        found = {"likeness": likeness(*device), "base_pulls": base_pulls(*device, seed)}
        return found | {"products": product_limits(*device) if limits and record == "poses" else {}}

    moving = record == "motion"
    diagnosis, more = diagnosis_of(DEVICES[record](plan), seed, also, limits, moving)
    seconds = time.process_time() - start
    return {"seed": seed, "seconds": seconds, "commit": made_of, "diagnosis": diagnosis, **more}


def _device(job):
    keep, make, made_of, case, seed, control = job
    words = (case.kind, case.record, case.sensor, *case.names, case.plan, f"{case.limits:g}")
    make = made_device if make else None
    return case, keep_outcome(
        keep, "_".join((*words, str(seed))), make, case, seed, control, made_of
    )


def made_device(case, seed, control, made_of):
    """Return the outcome of a device of a case, sized by its control."""
    start, effects = time.process_time(), choose_effects(case, seed, control)
    made = {"seed": seed, "commit": made_of, "control": control["diagnosis"], "diagnosis": None}
    made |= {"injected": [], "found": []}
    if effects is not None:
        truth = with_effects(DEVICES[case.record](case.plan), effects)
        moving = case.record == "motion"

        def also(*device):
            alike = alike_products(case.names[0], *device) if case.kind == "product" else {}
            return base_pulls(*device, seed), alike

        found = diagnosis_of(truth, seed, also, limits=False, motion=moving)
        made["diagnosis"], (made["base_pulls"], made["alike"]) = found
        made["injected"] = [
            {k: v for k, v in asdict(e).items() if k not in ("extra", "noise")} for e in effects
        ]
        made["found"] = [
            {**found, "expected": _expected_values(case, truth, seed, effect, found, record)}
            for effect in effects
            for record, found in effect_entries(
                made["diagnosis"], case.sensor, case.record, effect.name
            )
        ]
    return made | {"seconds": time.process_time() - start}


def _expected_values(case, truth, seed, effect, found, record):
    """Return the values of an injected effect in the variant that was found; {} of none."""
    if case.kind == "product":
        return effect.values if is_true(case, found) else {}
    return in_variant(truth, seed, effect, found, record)
