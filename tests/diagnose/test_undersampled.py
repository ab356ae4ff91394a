"""A device of turns by hand in a slow log: the rate is named, and nothing else."""

from calibrate import hand
from imuloop.simulate.truth import example_truth
from quick import diagnose_log
from seeds import least_count, seeds

TRUTH, RATE = example_truth(), 50.0


@seeds(1, 20)
def test_what_a_slow_log_lost_is_named_and_no_effect_is(seeds, tmp_path):
    named = unexplained = 0
    for seed in range(seeds):
        folder = tmp_path / str(seed)
        folder.mkdir()
        sensors = diagnose_log(folder, hand.log(RATE, seed, TRUTH), gravity=TRUTH.gravity)
        blocks = [sensors[s][r] for s in sensors for r in ("poses", "motion", "static_record")]
        named += any(block["effects"] for block in blocks)
        turns = sensors["gyroscope"]["poses"]
        unexplained += turns["verdict"] == "unexplained"
        lost = turns["residuals"]["rotation"]["undersampled"]
        assert lost["rate_hz"] < 50.1 and lost["enough_hz"] > 150
        assert lost["error"] < turns["residuals"]["rotation"]["floor"]
        # by the whole spectrum the remainder is about as large as the floor
        rotation = turns["residuals"]["rotation"]
        assert 0.5 < rotation["after"] / rotation["floor"] < 2
    allowed = seeds - least_count(seeds, 0.95, 0.05)
    assert named <= allowed and unexplained <= allowed
