"""The search in static records on simulated truth: the right name, and no name."""

import numpy as np
import pytest

from diagnose.records import LENGTH, record, root, search, temperature
from imuloop.core.effect import Channels, find_effect
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.diagnose.static_estimate import output
from imuloop.diagnose.static_find import find
from imuloop.diagnose.static_holdout import Blocks
from imuloop.diagnose.static_moves import separated
from imuloop.diagnose.static_scan import frequencies
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
    return finding.added


def pattern(name, n=N):
    """Return what an effect with a parameter of 1 on each axis adds, (n, 3), and its shape."""
    rec = record(np.zeros((n, 3)))
    known = {"ramp": Ramp(), "steps": Steps((70 * LENGTH,), ("s",))}
    known["sinusoid"] = Sinusoid(frequencies([rec])[30], ("s",))
    if name in known:
        shape = known[name]
    else:
        shape = find_effect(name).shapes(rec.channels)[0]
    at = (
        shape.in_session("s", rec.windows)
        if hasattr(shape, "in_session")
        else shape.design(rec.channels)
    )
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
    assert finding.choice.passed[at].ratio[1] < 1
    before, after = (np.mean(np.square(e)) for e in (finding.before, finding.after))
    assert after < 0.5 * before
    if name == "steps":
        assert abs(finding.base[at].effect.times[0] - shape.times[0]) <= LENGTH
    if name == "sinusoid":
        assert finding.base[at].effect.frequency == pytest.approx(shape.frequency, rel=0.02)


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
    times = sorted(t for p in finding.base for t in p.effect.times)
    np.testing.assert_allclose(times, [30 * LENGTH, 80 * LENGTH], atol=LENGTH)


def test_the_level_after_a_move_is_another_record():
    stretch = (np.arange(N) >= 70).astype(int)
    values = 0.01 * noise(5) + [0.0, 0.0, 9.8]
    assert len(separated([record(values, stretch=stretch)], 16)) == 1
    moved = values + np.outer(stretch, [0.0, 0.04, 0.0])
    parts = separated([record(moved, stretch=stretch)], 16)
    assert [len(p.windows) for p in parts] == [70, 50]
    assert {p.session for p in parts} == {"s"}
    np.testing.assert_array_equal(parts[1].values, moved[70:])
    assert parts[1].channels.remembered(lambda whole: whole.t)[0] == 70.5 * LENGTH
    # gravity that is larger afterwards is no tilt: the bias jumped; a large tilt lowers it
    heavier = values + np.outer(stretch, [0.0, 0.0, 0.04])
    assert len(separated([record(heavier, stretch=stretch)], 16)) == 1
    turned = values + np.outer(stretch, [0.0, 9.8 * np.sin(0.1), 9.8 * (np.cos(0.1) - 1)])
    assert len(separated([record(turned, stretch=stretch)], 16)) == 2
    # a drift that goes on through a disturbance is no move
    drifting = values + np.linspace(0, 0.3, N)[:, None]
    assert len(separated([record(drifting, stretch=stretch)], 16)) == 1
    # what is left of a part that is too short for blocks is left out
    late = (np.arange(N) >= 110).astype(int)
    moved = values + np.outer(late, [0.0, 0.04, 0.0])
    assert [len(p.windows) for p in separated([record(moved, stretch=late)], 16)] == [110]


def test_parameters_beyond_what_is_possible_are_no_effect():
    # a temperature drift of axes that carry no load, as large as no scale factor can make it
    values = noise(6)
    values[:, :2] += (temperature(N) - 20)[:, None]
    rec = record(values)
    shapes = find_effect("scale_temperature").shapes(rec.channels)
    one = search([rec], shapes)
    trial = one.trial((), type(shapes[0]))
    assert trial.log_p < one.threshold(0) and trial.impossible
    assert one.best(()) is None or one.best(()).pattern.name != "scale_temperature"


def test_sessions_share_the_parameters_and_have_their_own_levels():
    warm, _ = pattern("bias_temperature")
    records = [record(noise(k) + 10 * k + warm, name) for k, name in ((1, "a"), (2, "b"))]
    finding = find("accelerometer", records, records, SETTINGS, TESTS)
    assert names(finding) == ["bias_temperature"]
    for name, value in finding.effects[0].values.items():
        if name.startswith("c1"):
            assert abs(value - 1) < 4 * finding.effects[0].std[name]
    assert all(np.isfinite(e).all() for e in finding.after)


@pytest.mark.parametrize("kind", ["drift", "steps", "line", "two records"])
def test_what_a_held_out_block_holds_touches_nothing_that_predicts_it(kind):
    """Whatever the values of a block, what the others choose, estimate and predict stays."""
    rng, sessions = np.random.default_rng(11), "ab" if kind == "two records" else "a"
    add = {"drift": pattern("bias_temperature")[0], "steps": 3 * pattern("steps")[0]}
    add = add.get(kind, pattern("sinusoid")[0])
    values = {s: noise(30 + k) + add for k, s in enumerate(sessions)}
    blocks = found(values).blocks
    assert blocks.choice().base
    for block in (0, 4):
        changed = {s: v.copy() for s, v in values.items()}
        for fold, v in zip(blocks.folds, changed.values(), strict=True):
            v[fold == block] += 100 * rng.standard_normal(3) + rng.standard_normal((15, 3))
        out, others = frozenset({block}), found(changed).blocks
        choices = [b.choice(out) for b in (blocks, others)]
        effects = [[p.effect for p in choice.base] for choice in choices]
        assert effects[0] == effects[1] and effects[0]
        ratios = [[p.ratio for p in choice.passed] for choice in choices]
        np.testing.assert_allclose(*ratios, rtol=1e-6)
        foreseen = [
            [
                output(b.search(out), choice.base, [p.means[i] for p in choice.base])
                for i in range(len(sessions))
            ]
            for b, choice in zip((blocks, others), choices, strict=True)
        ]
        np.testing.assert_allclose(*foreseen, rtol=1e-5, atol=1e-7)
        # and nobody is judged by it
        errors = blocks.following((), out)
        for error, fold in zip(errors, blocks.folds, strict=True):
            assert np.isnan(error[fold == block]).all()
            assert np.isfinite(error[fold != block]).all()


def test_inner_blocks_are_shared():
    known = found(noise(12) + pattern("bias_temperature")[0]).blocks
    blocks = Blocks(known.model, known.shapes, SETTINGS, TESTS)
    blocks.errors(blocks.nested)
    kinds = [len(out) for out in blocks.searches]
    assert [kinds.count(n) for n in (0, 1, 2)] == [1, 8, 28]


def test_parts_of_the_data_keep_no_products():
    """Those of all parts at once were 2 GB for three sessions at rest."""
    blocks = found(noise(12) + pattern("bias_temperature")[0]).blocks
    kept = {out for out, search in blocks.searches.items() if search.sight._gram is not None}
    assert len(blocks.searches) > 1 and kept == {frozenset()}


def test_a_step_within_a_held_out_block_has_no_time():
    finding = found(noise(13) + 3 * pattern("steps")[0])
    blocks, (time,) = finding.blocks, pattern("steps")[1].times
    assert names(finding) == ["steps"]
    (block,) = {f for f in range(8) if blocks.folds[0][70] == f}
    (unseen,) = (p.effect for p in blocks.choice(frozenset({block})).base)
    # evenly over all of the block
    assert unseen.spans == (15 * LENGTH,)
    assert abs(unseen.times[0] - time) < 7.5 * LENGTH
    # a tenth and more of the step's square is left in the block, nothing beside it
    squares = [np.mean(finding.after[0][blocks.folds[0] == f] ** 2) for f in range(8)]
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
