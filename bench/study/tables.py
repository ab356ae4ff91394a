"""The study as a document of tables."""

import platform
from collections import Counter
from pathlib import Path

import numpy as np
import scipy
from scipy.stats import beta

from bench.study.cases import OUTSIDE
from bench.study.score import RATIO, SIGMAS, base_pulls, judge, pulls, ratio, settled

RECORDS = {
    "poses": "at the poses",
    "static_record": "in static records",
    "motion": "in motion",
}
NOTHING = "nothing"
# bounds of the study
RIGHT, ALARMS, INSIDE, INTERVALS = 0.90, 0.05, 0.95, (0.93, 0.97)


def document(outcomes, command, commit, first):
    """Return docs/study.md of outcomes by case; `first` is the seed of the first device."""
    chosen = {
        kind: {case: made for case, made in outcomes.items() if case.kind == kind}
        for kind in ("effect", "control", "two", "outside")
    }
    seconds = [made["seconds"] for all_made in outcomes.values() for made in all_made]
    head = (
        f"Written by `{command}`, never by hand: commit {commit}, "
        f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}. "
        f"{len(seconds)} devices, all simulated, from seed {first} on, their effects declared "
        f"nowhere; {np.mean(seconds):.1f} s each on one core."
    )
    parts = [
        ("# Simulated study of the diagnosis", head),
        ("## Against the bounds", bounds(chosen)),
        ("## One effect", effects(chosen["effect"])),
        ("## No effect", controls(chosen["control"])),
        ("## Two effects", two(chosen["two"])),
        ("## Outside the library", outside(chosen["outside"])),
        ("## Method", (Path(__file__).parent / "method.md").read_text().strip()),
    ]
    return "\n\n".join(f"{title}\n\n{text}" for title, text in parts if text) + "\n"


def table(header, rows):
    """Return a table in Markdown; columns after the first are numbers."""
    lines = ["| " + " | ".join(map(str, line)) + " |" for line in (header, *rows)]
    lines.insert(1, "|---|" + "--:|" * (len(header) - 1))
    return "\n".join(lines)


def share(part, whole):
    """Return a share with its 95 % interval after Clopper and Pearson."""
    if not whole:
        return "–"
    low = beta.ppf(0.025, part, whole - part + 1) if part else 0.0
    high = beta.ppf(0.975, part + 1, whole - part) if part < whole else 1.0
    return f"{part / whole:.0%} ({part} of {whole}; {low:.0%} to {high:.0%})"


def judged(cases):
    """Yield case, outcome and judgement of every device whose log can show its effect."""
    for case, all_made in cases.items():
        for made in all_made:
            if made["diagnosis"] is not None:
                yield case, made, judge(case, made)


def each_of(cases):
    """Yield every case with the outcomes and judgements of such devices."""
    for case, all_made in cases.items():
        yield case, [(made, j) for _, made, j in judged({case: all_made})]


def counted(names, quoted="`{}`"):
    """Return how often each name is there, the most frequent first, as text."""
    counts = Counter(names).most_common()
    return ", ".join(f"{count} {quoted.format(name)}" for name, count in counts)


def error_left(ratios):
    """Return the largest ratio, of those that there are, as text."""
    ratios = [r for r in ratios if r is not None]
    return f"{max(ratios):.2f}" if ratios else "–"


def bounds(chosen):
    """Return the table of the bounds and what was found."""
    one = [
        (case, made, j)
        for case, made, j in judged(chosen["effect"])
        if made["injected"][0]["limits"] > case.limits - 1e-6
    ]
    limits = next((case.limits for case, _, _ in one), 0.0)
    right = sum(not j["missed"] for _, _, j in one)
    found = [(case, made) for case, made, j in one if j["right"]]
    ratios = [r for case, made in found if (r := ratio(case, made)) is not None]
    steps = [ratio(case, made, whole=True) for case, made in found if "steps" in case.names]
    errors = np.concatenate([[], *(pulls(made) for _, made in found)])
    alarms = [bool(j["more"]) for _, _, j in judged(chosen["control"])]
    pairs = [not j["missed"] for _, _, j in judged(chosen["two"])]
    alien = [j for _, _, j in judged(chosen["outside"])]
    kept = sum(
        set(j["named"]) == {"discovered"} or (j["verdict"] == "unexplained" and not j["named"])
        for j in alien
    )
    inside = np.abs(errors) <= SIGMAS
    every = [each for cases in chosen.values() for each in judged(cases)]
    of_poses = [(case, made) for case, made, _ in every if case.record == "poses"]
    base = np.concatenate([[], *(base_pulls(*each) for each in of_poses)])
    held = np.array([r for _, made, _ in every for r in settled(made)])
    lines = [
        (f"right name or twin, at {limits:g} limits", f"≥ {RIGHT:.0%}", right, len(one), RIGHT),
        (f"held-out error after ≤ {RATIO} × without the effect", "all",
         sum(r <= RATIO for r in ratios), len(ratios), 1.0),
        ("the same, steps, with the block that each happens in", "all",
         sum(r <= RATIO for r in steps), len(steps), 1.0),
        (f"parameters within {SIGMAS:g} σ", f"≥ {INSIDE:.0%}", inside.sum(), len(inside), INSIDE),
        (f"95 % intervals of T, K and b, {len(of_poses)} devices", "93 to 97%",
         np.sum(np.abs(base) <= 1.96), len(base), INTERVALS),
        (f"`explained`, `consistent`: held-out error ≤ {RATIO} × floor", f"≥ {INSIDE:.0%}",
         np.sum(held <= RATIO), len(held), INSIDE),
        ("controls with any effect", f"≤ {ALARMS:.0%}", sum(alarms), len(alarms), None),
        ("both of two effects", "all", sum(pairs), len(pairs), 1.0),
        ("outside the library: `unexplained`, or a formula alone", "all", kept, len(alien), 1.0),
    ]  # fmt: skip
    rows = []
    for what, bound, part, whole, least in lines:
        if whole:
            good = part / whole <= ALARMS if least is None else part / whole >= np.min(least)
            good &= part / whole <= np.max(least) if least is INTERVALS else True
            rows.append((what, bound, share(part, whole), "yes" if good else "**no**"))
    return table(("what", "bound", "found", "met"), rows)


def effects(cases):
    """Return a table of the devices with one effect: a row per effect, a column per record."""
    places = list(dict.fromkeys((case.sensor, case.record) for case in cases))
    cells = {}
    for case, each in each_of(cases):
        row = cells.setdefault(case.names[0], dict.fromkeys(places, ""))
        row[case.sensor, case.record] = cell(case, each) if each else "not shown by this log"
    if not cells:
        return ""
    text = (
        "In a cell: devices in which the effect was named, of all that have it; largest error "
        f"left; parameters within {SIGMAS:g} σ. Behind a semicolon what was not as usual."
    )
    header = ("effect", *(f"{sensor} {RECORDS[record]}" for sensor, record in places))
    rows = [(f"`{name}`", *row.values()) for name, row in cells.items()]
    return f"{text}\n\n{table(header, rows)}"


def cell(case, each):
    """Return what was found of the devices of a case, as text."""
    found = [made for made, j in each if j["right"]]
    errors = np.concatenate([[], *map(pulls, found)])
    inside = f"{np.sum(np.abs(errors) <= SIGMAS)}/{len(errors)}" if len(errors) else "–"
    left = error_left(ratio(case, made) for made in found)
    parts = [f"{len(found)}/{len(each)}, {left}, {inside}"]
    size = np.median([made["injected"][0]["limits"] for made, _ in each])
    if size < case.limits - 1e-6:
        parts.append(f"{size:.2g} limits")
    if twins := counted(other for _, j in each for other in j["twins"].values()):
        parts.append(f"as a twin: {twins}")
    if more := sum(bool(j["more"]) for _, j in each):
        parts.append(f"with another: {more}")
    return "; ".join(parts)


def controls(cases):
    """Return a table of the devices without effect."""
    rows = []
    for case, each in each_of(cases):
        verdicts = [
            parts[case.record]["verdict"]
            for made, _ in each
            for parts in made["diagnosis"]["sensors"].values()
        ]
        rows.append(
            (
                f"searched {RECORDS[case.record]}",
                share(sum(bool(j["more"]) for _, j in each), len(each)),
                counted((f"`{name}` ({s})" for _, j in each for s, _, name in j["more"]), "{}")
                or "–",
                counted(verdicts, "{}"),
            )
        )
    header = ("devices", "with any effect", "which", "verdicts of both sensors")
    return rows and table(header, rows)


def two(cases):
    """Return a table of the devices with two effects."""
    rows = []
    for case, each in each_of(cases):
        both = [made for made, j in each if not j["missed"]]
        rows.append(
            (
                " and ".join(f"`{name}`" for name in case.names) + f", {case.sensor}",
                f"{len(both)}/{len(each)}",
                error_left(ratio(case, made) for made in both),
            )
        )
    return rows and table(("effects", "both named", "largest error left"), rows)


def outside(cases):
    """Return a table of the devices with an effect that the library lacks."""
    rows = []
    for case, each in each_of(cases):
        parts = [made["diagnosis"]["sensors"][case.sensor][case.record] for made, _ in each]
        rows.append(
            (
                f"{case.sensor}, degree {OUTSIDE[case.sensor][1]} of attitude",
                counted(j["verdict"] for _, j in each),
                counted(name for _, j in each for name in j["named"]) or NOTHING,
                counted(p["correlates"][0]["name"] for p in parts if p.get("correlates")) or "–",
            )
        )
    return rows and table(("device", "verdicts", "added", "correlates most with"), rows)
