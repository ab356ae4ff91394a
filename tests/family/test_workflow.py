"""The stage in the workflow: what waits for what."""

import re
from collections import Counter

import numpy as np
import pandas as pd
import yaml

from imuloop.core.samples import CHANNELS
from workflow.run import snakemake


def planned_jobs(repository, folder, devices, *arguments):
    """Return the number of jobs of each rule in a run."""
    (folder / "config.yaml").write_text(yaml.safe_dump({"devices": devices}))
    done = snakemake(repository, folder, "-n", "--quiet", "host", *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    jobs = re.findall(r"^(\w+) +(\d+)$", done.stdout + done.stderr, re.MULTILINE)
    return Counter({rule: int(count) for rule, count in jobs})


def test_a_family_waits_for_its_devices_and_none_of_them_for_another(repository, tmp_path):
    log = pd.DataFrame({"t": np.arange(400) / 100})
    log[[*CHANNELS]] = np.random.default_rng(0).normal([0, 0, 9.8, 0, 0, 0], 0.01, (400, 6))
    log.to_csv(tmp_path / "a.csv", index=False)
    one = {"sessions": {"poses": {"kind": "multi_position", "file": "a.csv"}}}
    plain = {f"d{k}": one for k in range(6)}
    assert "family" not in planned_jobs(repository, tmp_path, plain)
    typed = {name: one | {"type": "chip"} for name in plain}
    jobs = planned_jobs(repository, tmp_path, typed)
    assert jobs["family"] == 1 and jobs["report_device"] == 6
    # of a device its own files alone
    target = {"target": "results/d0/calibration.json"}
    done = snakemake(repository, tmp_path, "-n", "--quiet", "host", **target)
    assert not re.search(r"results/d[1-5]/", done.stdout)
