"""Static records of an accelerometer that was moved between two of their stretches."""

import numpy as np

from diagnose.records import LENGTH, record, root
from imuloop.diagnose.records.moves import separated

N = 120


def test_the_level_after_a_move_is_another_record():
    stretch = (np.arange(N) >= 70).astype(int)
    noise = root(N, 2.0, 5.0) @ np.random.default_rng(5).standard_normal((N, 3))
    values = 0.01 * noise + [0.0, 0.0, 9.8]
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
