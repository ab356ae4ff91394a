"""Poses and rotations gathered from segments, and poses whose noise is not known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t as student

from calibrate.devices import RATE_UNIT, calibrated, known_noise, recording
from imuloop.calibrate.calibrate import rest_bias, with_sessions, without_pose
from imuloop.calibrate.poses import gather_poses, gather_rotations, rounded_means, turns_within
from imuloop.calibrate.recording import Log, record
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel, SinusoidTerm
from imuloop.core.samples import CHANNELS
from imuloop.core.segments import segment_table
from imuloop.core.tables import write_table
from imuloop.simulate.truth import example_truth

TRUTH = example_truth()


def session(temperature=None):
    """Return 12 s at 10 Hz: rests of 3, 2 and 4 s, the first two one pose; ax counts samples."""
    t = np.arange(120) / 10
    log = pd.DataFrame({"t": t, **dict.fromkeys(CHANNELS, 0.0)})
    log["ax"] = np.arange(120.0)
    if temperature is not None:
        log["temperature"] = temperature
    edges = np.array([0, 3, 4, 6, 8, 12.0])
    kinds = ["static", "motion", "static", "motion", "static"]
    return log, segment_table(log, edges[:-1], edges[1:], kinds, [0, -1, 0, -1, 1])


def test_rests_of_one_pose_are_pooled_and_rotations_run_between_poses():
    log, table = session()
    poses = gather_poses([table, table])
    assert poses.session.tolist() == [0, 0, 1, 1]
    assert poses.n.tolist() == [50, 40, 50, 40]
    assert poses.duration_s.tolist() == [5, 4, 5, 4]
    assert poses.f[0, 0] == pytest.approx((30 * 14.5 + 20 * 49.5) / 50)
    rotations, shorter = (record([log] * 2, [table] * 2, s).rotations for s in (30.0, 1.9))
    # none from the first session to the second
    assert rotations.first.tolist() == [0, 2]
    assert (rotations.start_s[0], rotations.end_s[0]) == (5.9, 8.0)
    assert len(shorter) == 0


def test_gravity_at_both_ends_of_a_rest_that_tilts_follows_from_its_mean():
    """Protects: a turn starts and ends where the device is then, not at the mean of the rest."""
    t, bias, g = np.arange(1000) / 100, np.array([0.01, -0.02, 0.03]), 9.8
    # settles by 5 mrad in the first rest, 1 s; the second lies still
    angle = np.where(t < 5, 5e-3 * np.exp(-np.minimum(t, 5.0)), 5e-3 * np.exp(-5.0))
    u = np.column_stack([0 * t, np.sin(angle), np.cos(angle)])
    w = np.column_stack([np.gradient(angle, t), 0 * t, 0 * t]) + bias
    log = pd.DataFrame(np.column_stack([t, g * u, w]), columns=["t", *CHANNELS])
    edges = np.array([0, 5, 6, 10.0])
    table = segment_table(log, edges[:-1], edges[1:], ["static", "motion", "static"], [0, -1, 1])
    table["tilt_rad"] = [1e-3, 0.0, 0.0]
    poses = turns_within(gather_poses([table]), [Log.of(log)])
    direction = poses.f[0] / np.linalg.norm(poses.f[0])
    ends = [direction + np.cross(direction, turn[0]) for turn in (poses.to_start, poses.to_end)]
    # to the square of the tilt
    np.testing.assert_allclose(ends, u[[0, 499]], atol=2e-5)
    assert np.abs(u[0] - direction).max() > 1e-3
    assert not poses.to_start[1].any() and not poses.to_end[1].any()
    # and the rest says nothing of the bias below its turn over its length
    assert poses.extra_variance[0, 3:].min() == pytest.approx(12 * (1e-3 / 5) ** 2)
    assert not poses.extra_variance[1].any()


def test_a_hand_at_the_ends_of_a_rest_and_its_sway_leave_gravity_as_it_is():
    """Protects: velocity over the length of a rest is no specific force, nor is sway a loss."""
    t, g, arm = np.arange(1000) / 100, 9.8, np.array([0.0, 0.1, 0.0])
    # tremor of 0.5 mrad at 9 Hz that begins at its fastest, and sway of 10 mrad, about x
    parts = [(5e-4, 2 * np.pi * 9.1, 0.3), (1e-2, 2 * np.pi * 0.4, 1.0)]
    angle, rate, change = (
        sum(size * f**n * np.sin(f * t + phase + n * np.pi / 2) for size, f, phase in parts)
        for n in range(3)
    )
    u = np.column_stack([0 * t, np.sin(angle), np.cos(angle)])
    w = np.column_stack([rate, 0 * t, 0 * t])
    # without the sway's own acceleration
    tremor = change + parts[1][0] * parts[1][1] ** 2 * np.sin(parts[1][1] * t + parts[1][2])
    push = np.cross(np.column_stack([tremor, 0 * t, 0 * t]), arm)
    log = pd.DataFrame(np.column_stack([t, g * u + push, w]), columns=["t", *CHANNELS])
    edges = np.array([0, 4.05, 6, 10.0])
    table = segment_table(log, edges[:-1], edges[1:], ["static", "motion", "static"], [0, -1, 1])
    table["tilt_rad"] = [7e-3, 0.0, 7e-3]
    plain = gather_poses([table])
    poses = turns_within(plain, [Log.of(log)])
    before, after = (np.abs(np.linalg.norm(p.f, axis=1) - g).max() for p in (plain, poses))
    assert before > 5e-4
    assert after < 5e-5
    # as good against white noise as a plain mean over the time that it stands for
    assert np.all((poses.duration_s < plain.duration_s) & (poses.duration_s > 3.9 * 0.95))


def test_a_slow_turn_is_followed_from_before_it_shows():
    """A turn is followed 0.03 of its time, less 0.1 s, into both rests."""
    t = np.arange(2400) / 100
    log = pd.DataFrame({"t": t, **dict.fromkeys(CHANNELS, 0.0)})
    kinds = ["static", "motion", "static", "motion", "static"]
    tables = {}
    for still in (0.0, 1e-3):
        edges = np.array([0, 5.2, 14.8, 19, 21, 24.0])
        table = segment_table(log, edges[:-1], edges[1:], kinds, [0, -1, 1, -1, 2])
        table["tilt_rad"] = still
        inside = np.zeros((1, 2, len(t)), dtype=bool)
        how = [Log.of(log)], [table], 30.0, inside
        tables[still] = gather_rotations(gather_poses([table]), *how)[0]
    assert (tables[0.0].start_s[0], tables[0.0].end_s[0]) == pytest.approx((5.01, 14.99))
    # a quick one is not, nor is one from a rest of which each turn is known
    assert (tables[0.0].start_s[1], tables[0.0].end_s[1]) == pytest.approx((18.99, 21.0))
    assert (tables[1e-3].start_s[0], tables[1e-3].end_s[0]) == pytest.approx((5.19, 14.8))


@pytest.mark.parametrize(("noise", "most"), [(0.0, 1.1), (0.1, 2.5), (0.3, 1.3)])
def test_rounding_to_steps_larger_than_the_noise_adds_its_variance_to_the_means(noise, most):
    rng, step = np.random.default_rng(10), 0.04
    exact = rng.uniform(-1, 1, (4000, 1)) + step * noise * rng.standard_normal((4000, 400))
    logged = np.round(exact / step) * step
    # of what the means are off, that of independent samples is in the variance within the poses
    spread = np.var((logged - exact).mean(axis=1)) - step**2 / 12 / 400
    foreseen = rounded_means(logged.ravel(), logged.var(axis=1))
    assert 0.9 * spread < foreseen < most * spread


def test_noise_over_several_steps_or_values_without_steps_leave_nothing_of_rounding():
    x = np.random.default_rng(11).standard_normal((20, 400))
    assert rounded_means(x.ravel(), x.var(axis=1)) == 0.0
    x = np.round(x / 0.5) * 0.5
    assert rounded_means(x.ravel(), x.var(axis=1)) < 1e-9
    assert rounded_means(np.full(50, 9.8), np.zeros(2)) == 0.0


def test_missing_temperatures_are_interpolated_and_a_session_without_leaves_none():
    temperature = 20.0 + np.arange(120) / 100
    temperature[[0, 1, 2, 50, 51, 110]] = np.nan
    log, table = session(temperature)
    made = record([log], [table], 30.0)
    # on a straight line interpolation is exact; before the first value that value holds
    filled = np.maximum(20.0 + np.arange(120) / 100, 20.03)
    np.testing.assert_allclose(made.logs[0].temperature, filled)
    # a pose of two rests: everything from the first to the last of its samples
    np.testing.assert_allclose(made.poses.temperature, [filled[:60].mean(), filled[80:].mean()])
    assert np.isfinite(made.rotations.temperature).all()
    for cold in (session()[0], log.assign(temperature=np.nan)):
        made = record([log, cold], [table, table], 30.0)
        assert made.poses.temperature is None and made.rotations.temperature is None


def test_what_an_effect_remembers_is_averaged_over_poses_and_picked_along_rotations():
    log, table = session()
    made = record([log, log], [table, table], 30.0)

    def remembered(channels, factor):
        return factor * channels.output[:, 0]

    poses = made.pose_channels("accelerometer", lambda y: 2 * y, made.poses.w)
    found = poses.remembered(remembered, 10.0)
    np.testing.assert_allclose(found, 20 * np.array([29.5, 99.5, 29.5, 99.5]))
    np.testing.assert_allclose(poses.output, 2 * made.poses.f)
    along = made.rotation_channels("accelerometer", lambda y: 2 * y, made.rotations.w)
    found = along.remembered(remembered, 10.0).reshape(made.rotations.t.shape)
    np.testing.assert_allclose(found, 20 * made.rotations.f[..., 0])


LINES = AxisNoise(sinusoid=(SinusoidTerm(Coefficient(1e-3), Coefficient(4.613)),))


@pytest.mark.parametrize("axis", [1, 5])
@pytest.mark.parametrize(
    ("own", "variance", "what"),
    [
        (AxisNoise(), 0.0, "never changes within a pose"),
        (LINES, 1.0, "shows lines and no noise beside them"),
    ],
)
def test_an_axis_without_noise_is_a_reason_and_no_failure(axis, own, variance, what):
    made, known = recording(TRUTH, 0), known_noise(TRUTH)
    factor = np.where(np.arange(6) == axis, variance, 1.0)
    poses = replace(made.poses, variance=made.poses.variance * factor)
    noise = NoiseModel("d", {**known.axes, CHANNELS[axis]: own})
    force, turn = calibrated(replace(made, poses=poses), noise, TRUTH.gravity)
    reason = f"{CHANNELS[axis]} {what}: its noise is not known"
    for sensor, silent in ((force, axis < 3), (turn, axis >= 3)):
        expected = ("nominal", reason) if silent else ("multi_position", None)
        assert (sensor.method, sensor.not_testable) == expected
    rest = rest_bias(poses, noise, RATE_UNIT, "bias only")
    assert rest.method == ("nominal" if axis >= 3 else "static")
    # two axes are named both
    both = dict.fromkeys((CHANNELS[axis], CHANNELS[axis - 1]), own)
    silent = replace(poses, variance=0 * poses.variance) if not variance else poses
    found = silent.unknown_noise(NoiseModel("d", {**known.axes, **both}), CHANNELS)
    assert found.startswith(", ".join(c for c in CHANNELS if c in both) + f" {what}")


def test_a_bias_that_differs_between_power_cycles_is_as_sure_as_they_agree():
    made, known = recording(TRUTH, 0), known_noise(TRUTH)
    rng, off = np.random.default_rng(3), 0.01
    count, pulls = 4, []
    cycle = np.arange(len(made.poses)) * count // len(made.poses)
    for _ in range(400):
        w = made.poses.w + off * rng.standard_normal((count, 3))[cycle]
        rest = rest_bias(replace(made.poses, w=w, power_cycle=cycle), known, RATE_UNIT, "bias only")
        pulls.append((rest.b - TRUTH.gyroscope.b) / [rest.std[f"b{k}"] for k in range(3)])
    # Student's t with three degrees of freedom: within 3.182 in 95 %
    assert np.mean(np.abs(pulls) < student.ppf(0.975, count - 1)) == pytest.approx(0.95, abs=0.02)


def test_missing_poses_are_explained_by_what_became_of_the_sessions(tmp_path):
    empty = pd.DataFrame({"t": [], **{c: [] for c in CHANNELS}})
    moving = pd.DataFrame({"t": [0.0, 1.0], **{c: [0.0, 1.0] for c in CHANNELS}})
    write_table(tmp_path / "turns", segment_table(empty, [], [], [], []), {})
    write_table(tmp_path / "swing", segment_table(moving, [0.0], [2.0], ["motion"], [-1]), {})
    kind = "multi_position"
    sessions = {n: {"kind": kind, "segments": tmp_path / n} for n in ("turns", "swing")}
    reason = "no multi_position session with a pose"
    assert without_pose({}, kind) == reason
    assert without_pose(sessions, "six_position") == "no six_position session with a pose"
    explained = f"{reason}: turns was rejected, swing has no rest that is a pose"
    assert with_sessions(f"{reason}; bias only", sessions) == f"{explained}; bias only"
    assert with_sessions("9 poses found", sessions) == "9 poses found"
    assert with_sessions(None, sessions) is None
