"""What the search for effects outside the library finds in simulated devices.

Devices have white noise that is known and flicker that is not. What is put in is written here, by
its equation; one *limit* is the size that the library's own test of a known effect would find nine
times of ten, by the noncentral chi-square distribution.
"""

import argparse
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

import imuloop.effects  # noqa: F401  the library of effects
from bench.study.devices import poses_device
from imuloop.calibrate.pose_fits import AccelerometerPoses, GyroscopePoses, fitted_calibration
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import Effect
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel
from imuloop.core.precision import precision
from imuloop.core.units import RawUnit
from imuloop.diagnose.likeness import SHARE
from imuloop.diagnose.records.pose_diagnosis import pose_problem
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.discover.discover import discover, fitted, parts, rows_of
from imuloop.discover.space import space_of
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session

G = 9.80665
# tests of a device that share the significance, as the library has about
TESTS, SIGNIFICANCE, POWER = 30, 0.05, 0.9
SESSION = "multi_position"
# course of temperature, poses, and length of the rests, s, of a device
USUAL = (4.0, 8.0)
PLANS = {
    "forty": ("few", 40, USUAL),
    "eighty": ("usual", 80, USUAL),
    "ramp": ("ramp", 40, USUAL),
    "rests": ("few", 40, (4.0, 40.0)),
}


@dataclass(frozen=True)
class Truth:
    """What is put in: sensor, number of its parameters, and columns of the output, (n, 3, q)."""

    sensor: str
    columns: object
    # nobody can name it: no column has it
    nameless: bool = False


def _axis(values, axis):
    return values[:, None, None] * np.eye(3)[axis][None, :, None]


def _diagonal(values):
    return values[:, :, None] * np.eye(3)


def _matrix(values):
    return np.einsum("ij,nk->nijk", np.eye(3), values).reshape(len(values), 3, -1)


def _second(f):
    x, y, z = f.T
    return np.column_stack([x * x, y * y, z * z, x * y, x * z, y * z])


def _coupling(c):
    pairs = [(i, j) for i in range(3) for j in range(3) if i != j]
    return np.concatenate([_axis(c.output[:, i] * c.output[:, j], i) for i, j in pairs], axis=2)


def _settling(c, tau):
    """Return exp(-s/tau), s the time since the device last turned, sample by sample."""
    found, last = np.zeros(len(c.t)), -np.inf
    turning = np.linalg.norm(c.other, axis=1) > 0.2
    for k, t in enumerate(c.t):
        last = t if turning[k] else last
        found[k] = np.exp(-(t - last) / tau)
    return found


def _field(c):
    rng = np.random.default_rng(5)
    waves, phase = rng.normal(scale=4.0, size=(3, 12)), rng.uniform(0, 6.3, 12)
    return np.sin(c.output / G @ waves + phase).sum(axis=1)


def _one_pose(c):
    middle = c.t[len(c.t) // 2]
    return (np.abs(c.t - middle) < 5.0).astype(float)


def _flipped(c):
    return np.sign(c.t - c.t[len(c.t) // 2]) * c.output[:, 0] ** 3


def _warm(c):
    """Return the temperature less its mean."""
    return c.temperature - c.temperature.mean()


A, W = "accelerometer", "gyroscope"
TRUTHS = {
    "quadratic": Truth(A, lambda c: _diagonal(c.output**2)),
    "cubic": Truth(A, lambda c: _diagonal(c.output**3)),
    "asymmetry": Truth(A, lambda c: _diagonal(np.abs(c.output))),
    "cross_coupling": Truth(A, _coupling),
    "g2": Truth(W, lambda c: _matrix(_second(c.other))),
    "cubic_rate": Truth(W, lambda c: _diagonal(c.output**3)),
    "temperature_times_g": Truth(W, lambda c: _matrix(_warm(c)[:, None] * c.other)),
    "g_matrix": Truth(W, lambda c: _matrix(c.other)),
    "fy2_fz_on_x": Truth(A, lambda c: _axis(c.output[:, 1] ** 2 * c.output[:, 2], 0)),
    "wx_fy_on_z": Truth(W, lambda c: _axis(c.output[:, 0] * c.other[:, 1], 2)),
    "T2_fx_on_x": Truth(A, lambda c: _axis(_warm(c) ** 2 * c.output[:, 0], 0)),
    "settling_on_z": Truth(A, lambda c: _axis(_settling(c, 9.0), 2)),
    "kink": Truth(A, lambda c: _axis(np.abs(c.output[:, 1] - 4.0), 0), True),
    "degree_7": Truth(A, lambda c: _axis(c.output[:, 0] ** 3 * c.output[:, 1] ** 4, 2), True),
    "random_field": Truth(A, lambda c: _axis(_field(c), 0), True),
    "one_pose": Truth(A, lambda c: _axis(_one_pose(c), 0), True),
    "sign_midway": Truth(A, lambda c: _axis(_flipped(c), 1), True),
}


@dataclass(frozen=True)
class PutIn(Effect):
    """What was put in, as an effect that is known."""

    truth: str = ""
    name = "put_in"
    records = ()

    @property
    def parameters(self):
        """As many as it has columns."""
        return {f"p{k}": "1" for k in range(COUNTS[self.truth])}

    def design(self, channels):
        """Return its columns."""
        return TRUTHS[self.truth].columns(channels)


# what is known to the study alone is nothing to look for
del Effect.library[PutIn.name]

COUNTS = {"quadratic": 3, "cubic": 3, "asymmetry": 3, "cross_coupling": 6, "g2": 18}
COUNTS |= {"cubic_rate": 3, "temperature_times_g": 9, "g_matrix": 9}


@dataclass(frozen=True)
class Outcome:
    """What became of a device."""

    named: bool
    right: bool  # the space of the name is that of what was put in, or it holds it
    structure: bool  # something was found
    against_known: float  # held-out error over that with the true effect known
    formula: str
    margin: float
    chosen: int = 0  # candidates
    upper: float = np.nan  # of the ratio, of the kind where it is least
    left: float = 1.0  # as of a Discovery
    agreed: float = 0.0
    constant: float = 1.0
    lead: float = np.inf


class OtherPoses(Exception):
    """What is put in is so large that the log has other poses: no device of the study."""


def _noise(truth, whole=False):
    """Return the noise model of a device: white noise, and flicker up to a limit, or as it is."""

    def known(value):
        return Coefficient(value, (value, value), value, True)

    def unknown(limit):
        return Coefficient(None, None, limit, False)

    axes = {}
    for sensor, letter in ((truth.accelerometer, "a"), (truth.gyroscope, "g")):
        for i, axis in enumerate("xyz"):
            white, flicker = sensor.noise.N[i], sensor.noise.B[i]
            flicker = known(flicker) if whole else unknown(6 * flicker)
            axes[letter + axis] = AxisNoise(known(0.0), known(white), flicker, *[known(0.0)] * 2)
    return NoiseModel(truth.name, axes)


def _recording(truth, seed):
    samples = simulate_session(truth, SESSION, seed)
    segments = segment_session(samples, SESSION, SegmentSettings())[0]
    return record([samples], [segments], 30.0)


def _problem(truth, seed, sensor, noise):
    recording, settings = _recording(truth, seed), CalibrateSettings()
    force = AccelerometerPoses(noise, truth.gravity, RawUnit("m/s^2", 1.0), settings)
    if sensor == "gyroscope":
        calibration = fitted_calibration(force, force.fit(recording))
        force = GyroscopePoses(noise, calibration, RawUnit("rad/s", 1.0), settings)
    return pose_problem(force, recording, DiagnoseSettings(), TESTS)


def device(plan, seed):
    """Return the truth of a device, its flicker up to three times that of the example."""
    name, poses, rests = PLANS[plan]
    truth = poses_device(name)
    session = replace(truth.sessions[SESSION], poses=poses, rest_s=rests)
    factor = np.random.default_rng(seed).uniform(0.3, 3.0, size=2)
    sensors = {}
    for sensor, k in zip((A, W), factor, strict=True):
        own = getattr(truth, sensor)
        flicker = tuple(k * b for b in own.noise.B)
        sensors[sensor] = replace(own, noise=replace(own.noise, B=flicker))
    # its limit does not follow from its size
    return replace(truth, sessions={SESSION: session}, **sensors), _noise(truth)


def _with(truth, sensor, extra):
    return replace(truth, **{sensor: replace(getattr(truth, sensor), extra=extra)})


def one_limit(count):
    """Return the noncentrality of q parameters at which the library's test has its power."""
    threshold = chi2.isf(SIGNIFICANCE / TESTS, count)
    return brentq(lambda x: ncx2.sf(threshold, count, x) - POWER, 1e-3, 1e4)


def outcome(name, limits, plan, seed):
    """Return the Outcome of one device; of a control where the name is one of a sensor."""
    truth, noise = device(plan, seed)
    if name in (A, W):
        found = discover(_problem(truth, seed, name, noise))
        named = found.effect
        return Outcome(
            named is not None, False, bool(found.found.candidates), np.nan,
            named.formula if named else "", found.found.margin,
        )  # fmt: skip
    put = TRUTHS[name]
    plain = _problem(truth, seed, put.sensor, noise)
    rows = rows_of(plain, ())
    of_noise = plain.sensor.covariances(plain.linearized().solution, plain.recording)
    _, root = precision(of_noise(_noise(truth, whole=True)))
    base = np.linalg.qr(solve_triangular(root, rows.jacobian, lower=True))[0]
    rng = np.random.default_rng(seed + 1)

    def extra(channels, sizes):
        return np.einsum("nip,p->ni", put.columns(channels), sizes)

    def pattern(sizes):
        other = rows_of(
            _problem(
                _with(truth, put.sensor, partial(extra, sizes=sizes)), seed, put.sensor, noise
            ),
            (),
        )
        if len(other.values) != len(rows.values):
            raise OtherPoses
        white = solve_triangular(root, other.values - rows.values, lower=True)
        return white - base @ (base.T @ white)

    seen = []
    watched = lambda c: seen.append(put.columns(c)) or np.zeros((len(c.t), 3))  # noqa: E731
    simulate_session(_with(truth, put.sensor, watched), SESSION, seed)
    column_scale = np.sqrt((seen[-1] ** 2).sum(axis=1).mean(axis=0))
    signs = rng.normal(size=len(column_scale)) if len(column_scale) > 1 else np.ones(1)
    unit = signs / column_scale
    level = 2 * {A: 3e-4, W: 1e-4}[put.sensor]
    rank = len(unit)
    for _ in range(2):
        size = np.sqrt(np.sum(pattern(level * unit) ** 2))
        level *= limits * np.sqrt(one_limit(rank)) / size
    sizes = level * unit
    added = pattern(sizes)
    problem = _problem(
        _with(truth, put.sensor, partial(extra, sizes=sizes)), seed, put.sensor, noise
    )
    space = space_of(problem)
    found = discover(problem, space=space)
    right, against = False, np.nan
    if found.found.candidates:
        own = rows_of(problem, ())
        # what was put in, in units of the noise, against the space of what was found
        columns = space.columns[:, list(found.found.columns)]
        white = solve_triangular(root, columns, lower=True)
        white = np.linalg.qr(white - base @ (base.T @ white))[0]
        share = np.sum((white.T @ added) ** 2) / np.sum(added**2)
        right = bool(share >= SHARE and white.shape[1] <= 2 * rank)
        after = np.array([k["after"] for k in found.kinds.values()])
        # its columns; of one column what it adds
        known = problem.added(PutIn(name))[:, 0] if name in COUNTS else root @ added
        # what bias and scale factor take up goes
        known = _independent(known, own.jacobian)
        known = _known(problem, own, known, parts(problem))
        against = float(np.max(after / known))
    return Outcome(
        found.effect is not None, right, bool(found.found.candidates), against,
        space.effect(found.found.columns).formula, found.found.margin, len(found.found.candidates),
        min((k["ratio_ci95"][1] for k in found.kinds.values()), default=np.nan),
        found.left, found.agreed, found.constant, found.lead,
    )  # fmt: skip


def _independent(columns, jacobian):
    """Return a basis of columns beside a derivative, without what it takes up."""
    columns = columns.reshape(len(jacobian), -1)
    base = np.linalg.qr(jacobian / np.linalg.norm(jacobian, axis=0))[0]
    columns = columns / np.linalg.norm(columns, axis=0)
    left, size, _ = np.linalg.svd(columns - base @ (base.T @ columns), full_matrices=False)
    return left[:, size > 1e-3]


def _known(problem, rows, column, fold):
    """Return the held-out error of each kind with the pattern of the true effect known."""
    errors = np.zeros(len(rows.values))
    design = np.column_stack([rows.jacobian, column])
    for part in range(fold[:, 0].max() + 1):
        held = np.flatnonzero(fold[:, 0] == part)
        seen = np.flatnonzero(~(fold == part).any(axis=1))
        theta = fitted(rows.seen(seen), design[seen])[0]
        errors[held] = rows.values[held] - design[held] @ theta
    groups = [problem.of_kind(kind) for kind in problem.sensor.kinds]
    each = zip(problem.sensor.kinds, groups, strict=True)
    return np.array([np.sqrt(problem.components(k) * np.mean(errors[g] ** 2)) for k, g in each])


def _work(task):
    try:
        return task[:3], outcome(*task)
    except OtherPoses:
        return task[:3], None


def main():
    """Run devices and print a table."""
    parser = argparse.ArgumentParser(prog="python -m bench.discover", description=__doc__)
    parser.add_argument("--truths", default=",".join(TRUTHS), help="names, with commas")
    parser.add_argument("--controls", action="store_true", help="devices with nothing put in")
    parser.add_argument("--limits", default="3", help="sizes in limits, with commas")
    parser.add_argument("--plans", default="forty", help=f"of {', '.join(PLANS)}, with commas")
    parser.add_argument("--first", type=int, default=11000, help="seed of the first device")
    parser.add_argument("--seeds", type=int, default=5, help="devices of each case")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--verbose", action="store_true", help="a line for each device")
    options = parser.parse_args()
    names = (A, W) if options.controls else options.truths.split(",")
    sizes = [0.0] if options.controls else [float(s) for s in options.limits.split(",")]
    seeds = range(options.first, options.first + options.seeds)
    tasks = list(product(names, sizes, options.plans.split(","), seeds))
    cases = {}
    with ProcessPoolExecutor(options.workers) as pool:
        for task, (key, found) in zip(tasks, pool.map(_work, tasks), strict=True):
            cases.setdefault(key, []).extend([found] if found else [])
            if options.verbose:
                print(task, found, flush=True)
    print("| put in | limits | poses | devices | found | named | right | wrong | error/known |")
    print("|---|---|---|---|---|---|---|---|---|")
    for (name, size, plan), found in cases.items():
        count = Counter(
            what
            for o in found
            for what, so in (
                ("found", o.structure),
                ("named", o.named),
                ("right", o.named and o.right),
                ("wrong", o.named and not o.right),
            )
            if so
        )
        ratio = [o.against_known for o in found if np.isfinite(o.against_known)]
        row = [
            name,
            f"{size:g}",
            plan,
            len(found),
            *(count[k] for k in ("found", "named", "right", "wrong")),
        ]
        print("|", " | ".join(map(str, row)), "|", f"{np.median(ratio):.2f}" if ratio else "-", "|")


if __name__ == "__main__":
    main()
