"""The commands of docs/clusters.md: each is planned as it stands there."""

import re
import shlex

from cluster.conftest import KEYS, into_bucket, needs_plugin, run, write_config, write_devices


def test_every_command_of_the_document_can_be_planned(repository, s3, tmp_path):
    needs_plugin("executor_plugin_slurm")
    client, environment = s3
    devices = write_devices(tmp_path, ["imu"])
    into_bucket(client, tmp_path, devices, "bucket")
    write_config(tmp_path, devices)
    text = (repository / "docs/clusters.md").read_text()
    lines = re.findall(r"^\.venv-cluster/bin/snakemake .*$", text, re.M)
    assert len(lines) == 3
    for line in lines:
        words = shlex.split(line)
        assert words[-2:] == ["--", "results/report.html"]
        arguments = [str(repository / w) if w.startswith("profiles/") else w for w in words[1:-2]]
        arguments.remove("--configfile")
        arguments.remove("config.yaml")
        done = run(repository, tmp_path, *arguments, "-n", **environment | KEYS)
        assert done.returncode == 0, f"{line}\n{done.stderr}"
