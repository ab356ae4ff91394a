"""The study as two tables: against its bounds, and a row per case."""

from collections import Counter

import numpy as np

from bench.study.score import RATIO, SIGMAS, base_pulls, judge, pulls, ratio
from bench.tables import bound_text, share, table

# bounds of the study
RIGHT, ALARMS, INSIDE, INTERVALS = 0.90, 0.05, 0.95, (0.93, 0.97)


def document(outcomes, first):
    """Return the tables of outcomes by case; `first` is the seed of the first device."""
    seconds = [device["seconds"] for devices in outcomes.values() for device in devices]
    head = (
        f"{len(seconds)} devices, all simulated, from seed {first} on, their effects declared "
        f"nowhere; {np.mean(seconds):.1f} s each on one core."
    )
    parts = (head, "## Against the bounds", bounds(outcomes), "## Each case", cases(outcomes))
    return "\n\n".join(parts)


def judgements(outcomes, *kinds):
    """Return case, outcome and judgement of every device whose log can show its effect."""
    return [
        (case, device, judge(case, device))
        for case, devices in outcomes.items()
        for device in devices
        if device["diagnosis"] is not None and (not kinds or case.kind in kinds)
    ]


def bounds(outcomes):
    """Return the table of the bounds and of the figures found."""
    # what physics keeps below its size does not count
    one = [
        (case, device, j)
        for case, device, j in judgements(outcomes, "effect")
        if device["injected"][0]["limits"] > case.limits - 1e-6
    ]
    limits = next((case.limits for case, *_ in one), 0.0)
    right = [(case, device) for case, device, j in one if j["right"]]
    of_poses = [(c, device) for c, device, _ in judgements(outcomes) if c.record == "poses"]
    # no other block of a record at rest tells when a step in it happens
    ratios = np.array(
        [
            ratio(case, device)
            for case, device in right
            if case.record != "static_record" or "steps" not in case.names
        ]
    )
    errors = np.concatenate([[], *(pulls(device) for _, device in right)])
    base = np.concatenate([[], *(base_pulls(*pair) for pair in of_poses)])
    lines = [
        (f"right name or twin, at {limits:g} limits", "≥ 90%", [not j["missed"] for *_, j in one],
         (RIGHT, 1)),
        (f"held-out error after ≤ {RATIO} × without the effect", "all", ratios <= RATIO, (1, 1)),
        (f"parameters within {SIGMAS:g} σ", "≥ 95%", np.abs(errors) <= SIGMAS, (INSIDE, 1)),
        (f"95 % intervals of T, K and b, {len(of_poses)} devices", "93 to 97%",
         np.abs(base) <= 1.96, INTERVALS),
        ("controls with any effect", "≤ 5%",
         [bool(j["more"]) for *_, j in judgements(outcomes, "control")], (0, ALARMS)),
        ("both of two effects", "all", [not j["missed"] for *_, j in judgements(outcomes, "two")],
         (1, 1)),
    ]  # fmt: skip
    rows = [
        (what, bound, share(sum(good), len(good)), bound_text(low <= np.mean(good) <= high))
        for what, bound, good, (low, high) in lines
        if len(good)
    ]
    return table(("what", "bound", "found", "met"), rows)


def cases(outcomes):
    """Return the table of the cases, a row each."""
    header = (
        "put in", "sensor", "record", "named", "as a twin", "something else added",
        "largest error left", f"parameters within {SIGMAS:g} σ", "verdicts",
    )  # fmt: skip
    return table(header, [row(case, judgements({case: one})) for case, one in outcomes.items()])


def row(case, devices):
    """Return the row of a case; `devices` holds case, outcome and judgement of its devices."""
    names = " and ".join(case.names) or "nothing"
    if not devices:
        return (names, case.sensor, case.record, "not shown by this log", *"–––––")
    right = [device for _, device, j in devices if j.get("right") and not j["missed"]]
    errors = np.concatenate([[], *map(pulls, right)])
    ratios = [ratio(case, device) for device in right]
    verdicts = [
        part[case.record]["verdict"]
        for _, device, _ in devices
        for sensor, part in device["diagnosis"]["sensors"].items()
        if sensor == case.sensor or not case.sensor
    ]
    if case.kind == "effect":
        size = np.median([device["injected"][0]["limits"] for _, device, _ in devices])
        names += "" if size > case.limits - 1e-6 else f", {size:.2g} limits"
    return (
        names,
        case.sensor or "both",
        case.record,
        f"{len(right)}/{len(devices)}" if case.names else "–",
        count_names(twin for *_, j in devices for twin in j.get("twins", {}).values()),
        count_names(f"{name} ({sensor})" for *_, j in devices for sensor, _, name in j["more"]),
        f"{max(ratios):.2f}" if ratios else "–",
        f"{np.sum(np.abs(errors) <= SIGMAS)}/{len(errors)}" if len(errors) else "–",
        count_names(verdicts),
    )


def count_names(names):
    """Return the count of each name, the most frequent first, as text."""
    return ", ".join(f"{n} {name}" for name, n in Counter(names).most_common()) or "–"
