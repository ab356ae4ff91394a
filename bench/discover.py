"""What the search for effects outside the library finds in simulated devices.

Devices have white noise that is known and flicker that is not. What is put in is written here, by
its equation; one *limit* is the size that the library's own test of a known effect would find nine
times of ten, by the noncentral chi-square distribution.
"""

import argparse
from collections import namedtuple
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import LinAlgError, block_diag, solve_triangular
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

import imuloop.effects  # noqa: F401  the library of effects
from bench.study.devices import poses_device
from bench.tables import table
from imuloop.calibrate.calibrate import start_pair
from imuloop.calibrate.recording import record
from imuloop.calibrate.sensor_pair import OfSensor
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import Channels, Effect
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel
from imuloop.core.precision import precision
from imuloop.core.units import RawUnit
from imuloop.diagnose.likeness import SHARE
from imuloop.diagnose.records.pose_diagnosis import pose_problem
from imuloop.diagnose.records.static import StaticProblem
from imuloop.diagnose.records.static_windows import StaticRecord
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.discover.discovery import discover, error_ratios, heldout_errors
from imuloop.discover.search_input import of_poses, of_static, rows_of
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session

G = 9.80665
# tests of a device that share the significance, as the library has about
TESTS, SIGNIFICANCE, POWER = 30, 0.05, 0.9
SESSION = "multi_position"
UNITS = {"accelerometer": RawUnit("m/s^2", 1.0), "gyroscope": RawUnit("rad/s", 1.0)}
# course of temperature, poses, and length of the rests, s, of a device
USUAL = (4.0, 8.0)
PLANS = {
    "forty": ("few", 40, USUAL),
    "eighty": ("usual", 80, USUAL),
    "ramp": ("ramp", 40, USUAL),
    "rests": ("few", 40, (4.0, 40.0)),
}


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
    turning = np.linalg.norm(c.other, axis=1) > 0.2
    last = np.maximum.accumulate(np.where(turning, c.t, -np.inf))
    return np.exp(-(c.t - last) / tau)


def _field(c):
    rng = np.random.default_rng(5)
    waves, phase = rng.normal(scale=4.0, size=(3, 12)), rng.uniform(0, 6.3, 12)
    return np.sin(c.output / G @ waves + phase).sum(axis=1)


def _middle(c):
    return c.t - c.t[len(c.t) // 2]


def _warm(c):
    return c.temperature - c.temperature.mean()


# sensor, and columns of its output, (n, 3, q)
TRUTHS = {
    "quadratic": ("accelerometer", lambda c: _diagonal(c.output**2)),
    "cubic": ("accelerometer", lambda c: _diagonal(c.output**3)),
    "asymmetry": ("accelerometer", lambda c: _diagonal(np.abs(c.output))),
    "cross_coupling": ("accelerometer", _coupling),
    "g2": ("gyroscope", lambda c: _matrix(_second(c.other))),
    "cubic_rate": ("gyroscope", lambda c: _diagonal(c.output**3)),
    "temperature_times_g": ("gyroscope", lambda c: _matrix(_warm(c)[:, None] * c.other)),
    "g_matrix": ("gyroscope", lambda c: _matrix(c.other)),
    "fy2_fz_on_x": ("accelerometer", lambda c: _axis(c.output[:, 1] ** 2 * c.output[:, 2], 0)),
    "wx_fy_on_z": ("gyroscope", lambda c: _axis(c.output[:, 0] * c.other[:, 1], 2)),
    "T2_fx_on_x": ("accelerometer", lambda c: _axis(_warm(c) ** 2 * c.output[:, 0], 0)),
    "settling_on_z": ("accelerometer", lambda c: _axis(_settling(c, 9.0), 2)),
    # nobody can name these: no column has them
    "kink": ("accelerometer", lambda c: _axis(np.abs(c.output[:, 1] - 4.0), 0)),
    "degree_7": ("accelerometer", lambda c: _axis(c.output[:, 0] ** 3 * c.output[:, 1] ** 4, 2)),
    "random_field": ("accelerometer", lambda c: _axis(_field(c), 0)),
    "one_pose": ("accelerometer", lambda c: _axis((np.abs(_middle(c)) < 5.0) * 1.0, 0)),
    "sign_midway": ("accelerometer", lambda c: _axis(np.sign(_middle(c)) * c.output[:, 0] ** 3, 1)),
}


@dataclass(frozen=True)
class PutIn(Effect):
    """What was put in, as an effect that is known."""

    truth: str = ""
    count: int = 1
    name = "put_in"
    records = ()

    @property
    def parameters(self):
        """As many as it has columns."""
        return {f"p{k}": "1" for k in range(self.count)}

    def design(self, channels):
        """Return its columns."""
        return TRUTHS[self.truth][1](channels)


# what means at rest hold, (n, 1): of z = (T - mean)/half its range, its rate, at most 1, and time
# since the start, at the end 2
AT_REST = {
    "T": lambda z, rate, t: z[:, None],
    "T_t": lambda z, rate, t: (z * t)[:, None],
    "T_rate": lambda z, rate, t: (z * rate)[:, None],
    # nobody can name these
    "kink_in_T": lambda z, rate, t: np.abs(z - 0.3)[:, None],
    "waves_in_T": lambda z, rate, t: np.sin(9 * z)[:, None],
    "step_midway": lambda z, rate, t: np.sign(t - 1.1)[:, None],
    "sign_of_rate": lambda z, rate, t: np.sign(rate)[:, None],
}
# means at rest, and length of their windows, s
MEANS, WINDOW = 100, 120.0

# what is known to the study alone is nothing to look for
del Effect.library[PutIn.name]

# a Discovery; whether the space of what was found is that of what was put in, or holds it; and the
# held-out error over that with the true effect known, the largest
Outcome = namedtuple("Outcome", "discovery right against_known")


class OtherPoses(Exception):
    """What is put in is so large that the log has other poses: no device of the study."""


def _noise(truth, whole=False):
    """Return the noise model of a device: white noise, and flicker up to a limit, or as it is."""

    def known(value):
        return Coefficient(value, (value, value), value, True)

    axes = {}
    for sensor, letter in ((truth.accelerometer, "a"), (truth.gyroscope, "g")):
        for i, axis in enumerate("xyz"):
            white, flicker = sensor.noise.N[i], sensor.noise.B[i]
            flicker = known(flicker) if whole else Coefficient(None, None, 6 * flicker, False)
            axes[letter + axis] = AxisNoise(known(0.0), known(white), flicker, *[known(0.0)] * 2)
    return NoiseModel(truth.name, axes)


def device(plan, seed):
    """Return truth and noise of a device, its flicker up to three times that of the example."""
    name, poses, rests = PLANS[plan]
    truth = poses_device(name)
    session = replace(truth.sessions[SESSION], poses=poses, rest_s=rests)
    factor = np.random.default_rng(seed).uniform(0.3, 3.0, size=2)
    sensors = {}
    for sensor, k in zip(UNITS, factor, strict=True):
        own = getattr(truth, sensor)
        flicker = tuple(k * b for b in own.noise.B)
        sensors[sensor] = replace(own, noise=replace(own.noise, B=flicker))
    # its limit does not follow from its size
    return replace(truth, sessions={SESSION: session}, **sensors), _noise(truth)


def with_extra(truth, sensor, extra):
    """Return a device one of whose sensors has something more in its output."""
    return replace(truth, **{sensor: replace(getattr(truth, sensor), extra=extra)})


def problem_in(samples, sensor, gravity, noise, unit=UNITS["accelerometer"]):
    """Return the problem of poses, effects of a sensor; `unit` is of the accelerometer."""
    segments = segment_session(samples, SESSION, SegmentSettings())[0]
    recording, units = record([samples], [segments], 30.0), UNITS | {"accelerometer": unit}
    pair, _ = start_pair(recording, noise, gravity, units, CalibrateSettings())
    return pose_problem(pair, recording, DiagnoseSettings(), TESTS, sensors=(sensor,))


def problem_of(truth, seed, sensor, noise):
    """Return the problem of a sensor of a simulated device."""
    samples = simulate_session(truth, SESSION, seed)
    return problem_in(samples, sensor, truth.gravity, noise)


def _one_limit(count):
    """Return the noncentrality of q parameters at which the library's test has its power."""
    threshold = chi2.isf(SIGNIFICANCE / TESTS, count)
    return brentq(lambda x: ncx2.sf(threshold, count, x) - POWER, 1e-3, 1e4)


@cache
def control(plan, seed, sensor):
    """Return truth, noise and problem of a device with nothing put in, and a sensor's channels."""
    (truth, noise), seen = device(plan, seed), []
    watched = lambda c: seen.append(c) or np.zeros((len(c.t), 3))  # noqa: E731
    problem = problem_of(with_extra(truth, sensor, watched), seed, sensor, noise)
    return truth, noise, problem, seen[-1]


def outcome(name, limits, plan, seed):
    """Return the Outcome of one device; of a control where the name is one of a sensor."""
    if plan == "at_rest":
        return at_rest(name, limits, seed)
    if name in UNITS:
        return Outcome(discover(of_poses(control(plan, seed, name)[2], (), name)), False, np.nan)
    sensor, columns = TRUTHS[name]
    truth, noise, plain, channels = control(plan, seed, sensor)
    rows = rows_of(plain, ())
    x = plain.linearized().solution.fit.x
    of_noise = plain.sensor.covariance_at(x, plain.recording).by
    _, root = precision(of_noise(_noise(truth, whole=True)))
    base = np.linalg.qr(solve_triangular(root, rows.jacobian, lower=True))[0]

    def beside_base(values):
        white = solve_triangular(root, values, lower=True)
        return white - base @ (base.T @ white)

    def with_sizes(sizes):
        extra = partial(lambda c, p: np.einsum("nip,p->ni", columns(c), p), p=sizes)
        return problem_of(with_extra(truth, sensor, extra), seed, sensor, noise)

    def pattern(problem):
        other = rows_of(problem, ()).values
        if len(other) != len(rows.values):
            raise OtherPoses
        return beside_base(other - rows.values)

    column_scale = np.sqrt((columns(channels) ** 2).sum(axis=1).mean(axis=0))
    rank = len(column_scale)
    signs = np.random.default_rng(seed + 1).normal(size=rank) if rank > 1 else np.ones(1)
    sizes = {"accelerometer": 6e-4, "gyroscope": 2e-4}[sensor] * signs / column_scale
    for _ in range(2):
        square = np.sum(pattern(with_sizes(sizes)) ** 2)
        sizes = sizes * limits * np.sqrt(_one_limit(rank) / square)
    problem = with_sizes(sizes)
    added, searched = pattern(problem), of_poses(problem, (), sensor)
    found = discover(searched)
    space = found.space
    if not found.selection.candidates:
        return Outcome(found, False, np.nan)
    # what was put in, in units of the noise, against the space of what was found
    white = np.linalg.qr(beside_base(space.columns[:, list(found.selection.columns)]))[0]
    share = np.sum((white.T @ added) ** 2) / np.sum(added**2)
    right = bool(share >= SHARE and white.shape[1] <= 2 * rank)
    # its columns; of one column what it adds
    put_in = OfSensor(PutIn(name, rank), sensor)
    known = problem.added(put_in)[:, 0] if rank > 1 else root @ added
    known = _independent(known, searched.rows.jacobian)
    errors = heldout_errors(searched, [known] * len(searched.held_and_seen))
    ratios = error_ratios(searched, errors, found.heldout).values()
    return Outcome(found, right, max(kind["ratio"] for kind in ratios))


def at_rest(name, limits, seed):
    """Return the Outcome of means at rest, in a temperature that goes up and down.

    Noise of each axis is white, flicker and walk, these of a size between none and ten times the
    white noise in the slowest half wave. What is put in is on one axis.
    """
    rng = np.random.default_rng(seed)
    edges = WINDOW * np.arange(MEANS + 1)
    windows = np.column_stack([edges[:-1], edges[1:]])
    t, span = windows.mean(axis=1), edges[-1]
    knots = np.linspace(0, span, rng.integers(4, 8))
    course = CubicSpline(knots, rng.uniform(-1, 1, len(knots)))
    roots = []
    for _ in range(3):
        flicker, walk = 10 * rng.uniform(size=2) * (rng.uniform(size=2) < 0.7)
        own = {"N": 1.0, "B": np.sqrt(flicker * np.pi / span), "K": np.sqrt(walk) * np.pi / span}
        noise = AxisNoise(**{n: Coefficient(v, (v, v), v, True) for n, v in own.items()})
        roots.append(np.linalg.cholesky(noise.mean_covariance(windows)))
    # all axes in a row
    root, axis = block_diag(*roots), rng.integers(3)
    level = np.linalg.qr(
        solve_triangular(root, np.kron(np.eye(3), np.ones((MEANS, 1))), lower=True)
    )

    def beside_level(columns):
        white = solve_triangular(root, columns, lower=True)
        return white - level[0] @ (level[0].T @ white)

    values, added = root @ rng.normal(size=3 * MEANS), np.zeros((3 * MEANS, 1))
    if name in AT_REST:
        z, rate = course(t), course(t, 1)
        z = 2 * (z - z.mean()) / np.ptp(z)
        pattern = AT_REST[name](z, rate / np.abs(rate).max(), 2 * t / span)
        added[axis * MEANS : (axis + 1) * MEANS] = pattern
        added *= limits * np.sqrt(_one_limit(1)) / np.linalg.norm(beside_level(added))
        values = values + added[:, 0]
    whole = Channels(
        t, np.tile([0.1, -0.2, 9.8], (MEANS, 1)), np.zeros((MEANS, 3)), 25 + 15 * course(t)
    )
    seen = replace(whole, history=lambda function, *constants: function(whole, *constants))
    still = np.zeros(MEANS, dtype=int)
    record = StaticRecord("rest", windows, still, values.reshape(3, -1).T, seen)
    searched = of_static(StaticProblem((record,), {}, DiagnoseSettings(), TESTS), (), "gyroscope")
    found = discover(searched)
    if name not in AT_REST or not found.selection.candidates:
        return Outcome(found, False, np.nan)
    columns = searched.space.columns[:, list(found.selection.columns)]
    basis = np.linalg.qr(beside_level(columns / np.linalg.norm(columns, axis=0)))[0]
    share = np.sum((basis.T @ beside_level(added)) ** 2) / np.sum(beside_level(added) ** 2)
    return Outcome(found, bool(share >= SHARE and basis.shape[1] <= 2), np.nan)


def _independent(columns, jacobian):
    """Return a basis of columns beside a derivative, without what it takes up."""
    columns = columns.reshape(len(jacobian), -1)
    base = np.linalg.qr(jacobian / np.linalg.norm(jacobian, axis=0))[0]
    columns = columns / np.linalg.norm(columns, axis=0)
    left, size, _ = np.linalg.svd(columns - base @ (base.T @ columns), full_matrices=False)
    return left[:, size > 1e-3]


def _work(task):
    """Return the case of a device; found, named, right, wrong; error over that of the known."""
    try:
        made = outcome(*task)
    except OtherPoses:
        return task[:3], None
    except LinAlgError:
        # as a diagnosis has it: no formula
        return task[:3], ((False, False, False, False), np.nan, False)
    named, right = made.discovery.effect is not None, made.right
    words = bool(made.discovery.selection.candidates), named, named and right, named and not right
    return task[:3], (words, made.against_known, named and made.discovery.effect.formula)


def main():
    """Run devices and print a table."""
    parser = argparse.ArgumentParser(prog="python -m bench.discover", description=__doc__)
    parser.add_argument("--truths", default=",".join(TRUTHS), help="names, with commas")
    parser.add_argument("--controls", action="store_true", help="devices with nothing put in")
    parser.add_argument("--limits", default="3", help="sizes in limits, with commas")
    parser.add_argument(
        "--plans", default="forty", help=f"of {', '.join(PLANS)}, with commas; or at_rest"
    )
    parser.add_argument("--first", type=int, default=11000, help="seed of the first device")
    parser.add_argument("--seeds", type=int, default=5, help="devices of each case")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--verbose", action="store_true", help="a line for each device")
    options = parser.parse_args()
    names = UNITS if options.controls else options.truths.split(",")
    sizes = [0.0] if options.controls else [float(s) for s in options.limits.split(",")]
    seeds = range(options.first, options.first + options.seeds)
    tasks = list(product(names, sizes, options.plans.split(","), seeds))
    cases = {}
    with ProcessPoolExecutor(options.workers) as pool:
        for task, (key, made) in zip(tasks, pool.map(_work, tasks), strict=True):
            cases.setdefault(key, []).extend([made] if made else [])
            if options.verbose:
                print(task, made, flush=True)
    rows = []
    for (name, size, plan), made in cases.items():
        words, ratios = (np.array([each[k] for each in made]) for k in (0, 1))
        left = f"{np.nanmedian(ratios):.2f}" if np.isfinite(ratios).any() else "-"
        count = words.reshape(-1, 4).sum(axis=0).astype(int)
        rows.append((name, f"{size:g}", plan, len(made), *count, left))
    head = ("put in", "limits", "poses", "devices", "found", "named", "right", "wrong")
    print(table((*head, "error/known"), rows))


if __name__ == "__main__":
    main()
