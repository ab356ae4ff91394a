"""The stage in the workflow: what waits for what, and a device without a prior."""

import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml

from family.test_prior import NOISE, by_poses, device, values
from imuloop.chain import Device, export, family_prior
from imuloop.core.files import write_json
from imuloop.core.model import Calibration
from imuloop.core.samples import CHANNELS
from imuloop.family.family import Member, of_type
from result_files import fault
from workflow.run import snakemake


def planned_jobs(repository, folder, devices, *arguments):
    """Return how many jobs of each rule a run would have."""
    (folder / "config.yaml").write_text(yaml.safe_dump({"devices": devices}))
    done = snakemake(repository, folder, "-n", "--quiet", "host", *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    jobs = re.findall(r"^(\w+) +(\d+)$", done.stdout + done.stderr, re.MULTILINE)
    return Counter({rule: int(count) for rule, count in jobs})


def test_only_who_asks_for_a_prior_waits_for_others(repository, tmp_path):
    log = pd.DataFrame({"t": np.arange(400) / 100})
    log[[*CHANNELS]] = np.random.default_rng(0).normal([0, 0, 9.8, 0, 0, 0], 0.01, (400, 6))
    log.to_csv(tmp_path / "a.csv", index=False)
    one = {"sessions": {"poses": {"kind": "multi_position", "file": "a.csv"}}}
    plain = {f"d{k}": one for k in range(6)}
    assert not {"family", "family_prior"} & {*planned_jobs(repository, tmp_path, plain)}
    typed = {name: one | {"type": "chip", "serial": k} for k, name in enumerate(plain)}
    jobs = planned_jobs(repository, tmp_path, typed)
    assert jobs["family"] == 1 and not jobs["family_prior"] and jobs["export"] == 6
    asking = typed | {name: typed[name] | {"prior": "family"} for name in ("d4", "d5")}
    jobs = planned_jobs(repository, tmp_path, asking)
    assert jobs["family_prior"] == jobs["export_with_prior"] == 2
    assert jobs["report_device_with_prior"] == 2 and jobs["report_device"] == jobs["export"] == 4
    # of a device without a prior its own files alone
    target = {"target": "results/d0/calibration.json"}
    done = snakemake(repository, tmp_path, "-n", "--quiet", "host", **target)
    assert not re.search(r"results/d[1-5]/", done.stdout)


@pytest.fixture
def folders(tmp_path):
    """Return results of devices by 26 poses; the first does not know its gyroscope."""
    for k in range(6):
        folder = tmp_path / f"d{k}"
        folder.mkdir()
        by_poses(device(k), k, 26)[1].to_json(folder / "calibration.json")
    first = tmp_path / "d0"
    own = Calibration.from_json(first / "calibration.json")
    own = replace(own, gyroscope=replace(own.gyroscope, names=(), covariance=None))
    own.to_json(first / "calibration.json")
    own.to_json(first / "multi_position.json")
    write_json(first / "noise.json", NOISE.to_dict())
    # as far as the exports read it
    content = {"sensors": {sensor: {} for sensor in ("accelerometer", "gyroscope")}}
    write_json(first / "diagnosis.json", content)
    return sorted(tmp_path.iterdir())


def test_a_device_is_completed_and_its_exports_say_so(folders):
    first, *others = folders
    write_json(first / "noise.json", NOISE.to_dict() | {"rate_hz": 50.0, "notes": []})
    asking = Device("d0", first, {}, prior="family")
    family_prior(asking, others)
    assert fault(first / "family_calibration.json") is None
    own, found = (
        Calibration.from_json(first / f"{n}.json") for n in ("calibration", asking.calibration.stem)
    )
    assert found.gyroscope.method == "family" and found.accelerometer.method == "multi_position"
    others_mean = np.mean(
        [values(Calibration.from_json(o / "calibration.json")) for o in others], 0
    )
    np.testing.assert_allclose(values(found)[9:], others_mean[9:], atol=1e-3)
    np.testing.assert_allclose(values(found)[:9], values(own)[:9], rtol=1e-3, atol=1e-4)
    export(asking)
    text = (first / "exports/README.txt").read_text()
    assert "../family_calibration.json and" in text
    # without the prior nothing of it is read
    export(replace(asking, prior=None))
    assert "../calibration.json and" in (first / "exports/README.txt").read_text()


def test_with_too_few_others_a_device_keeps_its_calibration_and_says_so(folders):
    first, *others = folders
    write_json(first / "noise.json", NOISE.to_dict() | {"rate_hz": 50.0, "notes": []})
    asking = Device("d0", first, {}, prior="family")
    family_prior(asking, others[:3])
    assert fault(first / "family_calibration.json") is None
    own, found = (
        Calibration.from_json(first / f"{n}.json") for n in ("calibration", asking.calibration.stem)
    )
    np.testing.assert_array_equal(values(own), values(found))
    members = [
        Member(path.name, Calibration.from_json(path / "calibration.json"), NOISE, {})
        for path in folders[:4]
    ]
    assert of_type([replace(members[0], with_prior=found), *members[1:]])["priors"] == {}
    export(asking)
    assert "fewer than 4 other devices" in (first / "exports/README.txt").read_text()
