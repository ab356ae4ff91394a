"""Static records of simulated truth: what fits to them say, the right name, and no name."""

from dataclasses import replace

import numpy as np
import pytest

from diagnose.records import LENGTH, record, root, search, temperature
from imuloop.core.effect import Channels, find_effect
from imuloop.diagnose import choice
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.records.scan import frequencies
from imuloop.diagnose.records.static import FITTED, fitted, fold_of, information
from imuloop.diagnose.records.static_diagnosis import find
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.effects.bias_temperature import BiasTemperature
from imuloop.effects.gauss_markov import GaussMarkov
from imuloop.effects.ramp import Ramp
from imuloop.effects.sinusoid import Sinusoid
from imuloop.effects.steps import Steps

N = 120
SETTINGS = DiagnoseSettings()
TESTS = 26


def noise(seed, flicker=2.0, walk=5.0, n=N):
    return root(n, flicker, walk) @ np.random.default_rng(seed).standard_normal((n, 3))


def found(values, **more):
    """Return what is found in values (n, 3), or in those of several sessions by name."""
    values = values if isinstance(values, dict) else {"s": values}
    records = [record(v, session, **more) for session, v in values.items()]
    return find("accelerometer", records, records, SETTINGS, TESTS)


def names(finding):
    return [e.name for e in finding.effects] + [GaussMarkov.name] * finding.has_process


def pattern(name, n=N):
    """Return what an effect with a parameter of 1 on each axis adds, (n, 3), and its shape."""
    rec = record(np.zeros((n, 3)))
    known = {"ramp": Ramp(), "steps": Steps((70 * LENGTH,), ("s",))}
    known["sinusoid"] = Sinusoid(frequencies([rec])[30], ("s",))
    if name in known:
        shape = known[name]
    else:
        shape = find_effect(name).shapes(rec.channels)[0]
    at = shape.in_session(rec.channels, "s", rec.windows)
    return at[:, range(3), range(3)], shape


@pytest.mark.parametrize(
    "name",
    [
        *("bias_temperature", "bias_temperature_rate", "thermal_hysteresis", "warm_up"),
        *("ramp", "sinusoid", "steps"),
    ],
)
def test_each_effect_is_found_by_its_name(name):
    add, shape = pattern(name)
    # white noise of a mean is 1/sqrt(60)
    add = add / np.abs(add - add.mean(axis=0)).max() * {"ramp": 6.0}.get(name, 3.0)
    # a warm-up is over after the first block of time: two starts to foresee one, and without it
    sessions = "stu" if name == "warm_up" else "s"
    records = [record(noise(k) + add, s) for k, s in enumerate(sessions)]
    finding = find("accelerometer", records, records, SETTINGS, TESTS)
    assert name in names(finding)
    at = names(finding).index(name)
    assert finding.choices.choice().added[at].ratio[1] < 1
    assert np.mean(finding.after**2) < 0.5 * np.mean(finding.before**2)
    if name == "steps":
        assert abs(finding.effects[at].effect.times[0] - shape.times[0]) <= LENGTH
    if name == "sinusoid":
        assert finding.effects[at].effect.frequency == pytest.approx(shape.frequency, rel=0.02)


def test_devices_without_an_effect_have_none():
    kinds = ((0, 0), (5, 0), (0, 5), (3, 3))
    alarms = [names(found(noise(20 + k, *kinds[k % 4]))) for k in range(16)]
    # 2 % of searches of one sensor; two or more of 16 happen in 4 % of such sets
    assert sum(map(bool, alarms)) <= 1


def test_two_effects_are_found_one_after_the_other():
    warm, _ = pattern("bias_temperature")
    line, _ = pattern("sinusoid")
    finding = found(noise(3) + 0.5 * warm + 1.5 * line)
    assert set(names(finding)) == {"bias_temperature", "sinusoid"}


def test_several_steps_are_found():
    values = noise(4)
    for place, height in ((30, 3.0), (80, -4.0)):
        values[place:] += height
    finding = found(values)
    assert names(finding) == ["steps"]
    times = sorted(t for e in finding.effects for t in e.effect.times)
    np.testing.assert_allclose(times, [30 * LENGTH, 80 * LENGTH], atol=LENGTH)


def test_parameters_beyond_what_is_possible_are_no_effect():
    # a temperature drift of axes that carry no load, as large as no scale factor can make it
    values = noise(6)
    values[:, :2] += (temperature(N) - 20)[:, None]
    rec = record(values)
    shapes = find_effect("scale_temperature").shapes(rec.channels)
    one = search([rec], shapes)
    trial = one.trial((), type(shapes[0]))
    assert trial.log_p < one.threshold(0) and trial.impossible
    assert one.best(()) is None or one.best(()).effect.name != "scale_temperature"


def test_sessions_share_the_parameters_and_have_their_own_levels():
    warm, _ = pattern("bias_temperature")
    records = [record(noise(k) + 10 * k + warm, name) for k, name in ((1, "a"), (2, "b"))]
    finding = find("accelerometer", records, records, SETTINGS, TESTS)
    assert names(finding) == ["bias_temperature"]
    for name, value in finding.effects[0].values.items():
        if name.startswith("c1"):
            assert abs(value - 1) < 4 * finding.effects[0].std[name]
    assert np.isfinite(finding.after).all()


@pytest.mark.parametrize("kind", ["drift", "steps", "line", "two records"])
def test_what_a_held_out_block_holds_touches_nothing_that_predicts_it(kind):
    """Whatever the values of a block, what the others choose, estimate and predict stays."""
    rng, sessions = np.random.default_rng(11), "ab" if kind == "two records" else "a"
    add = {"drift": pattern("bias_temperature")[0], "steps": 3 * pattern("steps")[0]}
    add = add.get(kind, pattern("sinusoid")[0])
    values = {s: noise(30 + k) + add for k, s in enumerate(sessions)}
    choices = found(values).choices
    assert choices.choice().base
    ends = np.cumsum([N] * len(values))[:-1]
    for block in (0, 4):
        changed = {s: v.copy() for s, v in values.items()}
        for fold, v in zip(np.split(choices.problem.fold, ends), changed.values(), strict=True):
            v[fold == block] += 100 * rng.standard_normal(3) + rng.standard_normal((15, 3))
        out, both = frozenset({block}), (choices, found(changed).choices)
        chosen = [c.choice(out) for c in both]
        assert chosen[0].base == chosen[1].base and chosen[0].base
        ratios = [[a.ratio for a in one.added] for one in chosen]
        np.testing.assert_allclose(*ratios, rtol=1e-6)
        foreseen = [
            np.concatenate([r.values for r in c.problem.records])
            - c.problem.left(c.search(out), one.base)
            for c, one in zip(both, chosen, strict=True)
        ]
        np.testing.assert_allclose(*foreseen, rtol=1e-5, atol=1e-7)
        # and nobody is judged by it
        errors, held = choices.following((), out), choices.problem.fold == block
        assert np.isnan(errors[held]).all()
        assert np.isfinite(errors[~held]).all()


def test_inner_blocks_are_shared(monkeypatch):
    problem = found(noise(12) + pattern("bias_temperature")[0]).choices.problem
    searches, made = [], choice.Search

    def counted(problem, out):
        searches.append(len(out))
        return made(problem, out)

    monkeypatch.setattr(choice, "Search", counted)
    choices = Choices(problem)
    choices.errors(choices.nested)
    assert [searches.count(n) for n in (0, 1, 2)] == [1, 8, 28]


def test_parts_of_the_data_keep_no_products():
    """Those of all parts at once were 2 GB for three sessions at rest."""
    problem = found(noise(12) + pattern("bias_temperature")[0]).choices.problem
    sights = problem.evidence._sights
    kept = {out for (out, _), sight in sights.items() if sight._gram is not None}
    assert len(sights) > 1 and kept == {frozenset()}


def test_a_step_within_a_held_out_block_has_no_time():
    finding = found(noise(13) + 3 * pattern("steps")[0])
    choices, (time,) = finding.choices, pattern("steps")[1].times
    assert names(finding) == ["steps"]
    fold = choices.problem.fold
    block = int(fold[70])
    (unseen,) = choices.choice(frozenset({block})).base
    # evenly over all of the block
    assert unseen.spans == (15 * LENGTH,)
    assert abs(unseen.times[0] - time) < 7.5 * LENGTH
    # a tenth and more of the step's square is left in the block, nothing beside it
    squares = [np.mean(finding.after[fold == f] ** 2) for f in range(8)]
    assert np.argmax(squares) == block and 0.1 * 9 < squares[block] < 0.5 * 9
    assert np.delete(squares, block).max() < 0.1 * 9


def test_without_a_temperature_its_effects_cannot_be_tried():
    finding = found(noise(8), warm=False)
    assert finding.others[find_effect("bias_temperature")][0] == "not_available"
    assert names(finding) == []


def test_channels_of_a_record_give_the_shapes():
    rec = record(noise(9))
    assert isinstance(rec.channels, Channels)
    assert len(find_effect("bias_temperature").shapes(rec.channels)) == 3


def test_estimates_and_their_errors_hold_in_slow_noise():
    rng, true = np.random.default_rng(4), 0.4
    made, effect = root(N, 10, 20), BiasTemperature(1, 20.0)
    off = []
    for _ in range(40):
        rec = record(made @ rng.standard_normal((N, 3)))
        rec.values[:] += true * (rec.channels.temperature - 20)[:, None]
        (one,) = fitted(search([rec], [effect]), (effect,))
        off += [(one.values[name] - true) / one.std[name] for name in ("c1x", "c1y", "c1z")]
    assert abs(np.mean(off)) < 0.3
    # 120 estimates in units of their standard error
    assert 0.75 < np.std(off) < 1.2
    assert np.mean(np.abs(off) < 3) > 0.97


def test_fitted_effects_have_their_names():
    rec = record(np.random.default_rng(6).normal(size=(100, 3)))
    rec.values[:] += rec.channels.t[:, None] * [1e-3, 2e-3, 3e-3]
    one = search([rec], [Ramp()])
    (ramp,) = fitted(one, (Ramp(),))
    assert list(ramp.values) == ["dx", "dy", "dz"]
    for name, true in (("dx", 1e-3), ("dy", 2e-3), ("dz", 3e-3)):
        assert abs(ramp.values[name] - true) < 4 * ramp.std[name]
    assert fitted(one, ()) == ()


def test_what_records_tell_of_parameters_is_what_a_fit_finds():
    """The estimate is its maximum, whatever is beside it; its errors are those of the fit.

    Of a pattern alone, that is: those of several together are larger, or hardly smaller.
    """
    warm, line, step = BiasTemperature(1, 20.0), Ramp(), Steps((70 * LENGTH,), ("s",))
    rec = record(noise(14))
    rec.values[:] += 0.2 * (rec.channels.temperature - 20)[:, None]
    rec.values[70:] += 3.0
    one = search([rec], [])
    for base, effects in (
        ((warm,), (warm,)),
        ((line,), (line,)),
        ((warm, line), (warm, line)),
        ((warm, line, step), (warm, line)),
        ((warm, line, step), (line,)),
    ):
        precision, moment = information(one, base, effects)
        known = [e for e in fitted(one, base) if e.effect in effects]
        values, std = (
            np.concatenate([list(v.values()) for v in each])
            for each in zip(*((e.values, e.std) for e in known), strict=True)
        )
        np.testing.assert_allclose(np.linalg.solve(precision, moment), values, rtol=1e-6)
        errors = np.sqrt(np.diag(np.linalg.inv(precision)))
        if len(base) == 1:
            np.testing.assert_allclose(errors, std, rtol=1e-6)
        assert np.all(errors > 0.9 * std)
    # a step before the record is a level
    found = information(one, (line,), (line, Steps((-5.0,), ("s",))))
    expected = information(one, (line,), (line,))
    np.testing.assert_allclose(found[0][:3, :3], expected[0], rtol=1e-6)
    np.testing.assert_allclose(found[1][:3], expected[1], rtol=1e-6)
    size = np.sqrt(np.diag(information(one, (line,), (line, step))[0]))
    assert size.all()
    np.testing.assert_allclose((found[0] / np.outer(size, size))[3:], 0, atol=1e-9)


def test_long_records_are_fitted_on_fewer_windows():
    problem = search([record(np.random.default_rng(7).normal(size=(900, 3)))], []).problem
    assert len(problem.records[0].windows) == len(problem.fold) == 900
    assert len(problem.fitted[0].windows) <= FITTED


@pytest.mark.parametrize("n", [64, 900])
def test_a_fold_of_other_windows_is_what_its_windows_of_the_fit_cover(n):
    records = [record(np.random.default_rng(8).normal(size=(n, 3)), name) for name in "ab"]
    problem = search(records, []).problem
    for number, (own, fold) in enumerate(zip(problem.fitted, problem.folds, strict=True)):
        means = fold_of(records[number], problem)
        assert set(means) == set(range(8))
        for window, at in zip(own.windows, fold, strict=True):
            inside = records[number].windows[:, 0] >= window[0]
            inside &= records[number].windows[:, 1] <= window[1]
            assert inside.any() and np.all(means[inside] == at)
        # windows across the edges of blocks belong to none
        across = replace(records[number], windows=records[number].windows + 0.5 * LENGTH)
        assert np.sum(fold_of(across, problem) == -1) == 8
    # the start of each record is held out with another block of the other
    assert fold_of(records[0], problem)[0] == 0 and fold_of(records[1], problem)[0] == 4


def test_a_step_that_nobody_saw_goes_up_evenly():
    unknown = Steps((300.0,), ("s",), (240.0,))
    seen = np.array([[0.0, 60], [120, 180], [180, 240], [240, 300], [360, 420], [420, 480]])
    outer = unknown.in_session(None, "s", seen)[:, 0, 0]
    assert list(outer[[0, 1, -1]]) == [0, 0, 1]
    inner = seen[(seen[:, 0] >= 180) & (seen[:, 1] <= 420)]
    # the mean over all times that the step may have
    times = np.linspace(180, 420, 4801)[:-1] + 0.025
    known = [Steps((t,), ("s",)).in_session(None, "s", inner)[:, 0, 0] for t in times]
    even = unknown.in_session(None, "s", inner)[:, 0, 0]
    np.testing.assert_allclose(even, np.mean(known, axis=0), atol=1e-3)


def test_patterns_of_windows_are_means_of_their_instants():
    at = np.array([[0.0, 10.0], [10.0, 20.0], [20.0, 30.0]])
    fine = np.column_stack([np.arange(30) + 0.5] * 2)
    for effect in (Steps((14.0,), ("s",)), Sinusoid(0.03, ("s",))):
        instants = np.linspace(0, 30, 30001)[:-1]
        dense = effect.in_session(None, "s", np.column_stack([instants, instants]))
        means = dense.reshape(3, 10000, 3, -1).mean(axis=1)
        np.testing.assert_allclose(effect.in_session(None, "s", at), means, atol=1e-3)
        assert not effect.in_session(None, "other", fine).any()
        assert len(effect.parameters) == dense.shape[2]
