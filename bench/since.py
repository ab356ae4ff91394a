"""Processor time of the same work by an earlier commit and by this one: `make bench BASE=COMMIT`.

Each commit has its own copy and its own environment, from its own lock file. The two take turns, a
process each; counted is the processor time of that process and its children, imports included. The
ratio is of the medians; its spread, of the rounds.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from bench.realistic.device import record
from bench.tables import REPOSITORY, publish, table
from bench.workflow import KINDS, device, make_logs, timed_process, write_config

# seed of the device whose thermometer is late, with many candidates near the threshold
LATE = 5009
# devices of a dry run
MANY = 200

STAGE = """
import sys, yaml
from pathlib import Path
from imuloop import chain
name, folder, config = sys.argv[1:]
config = yaml.safe_load(Path(config).read_text())
own, all_of = config["devices"][name], config.get("defaults") or {}
settings = {
    stage: {**all_of.get(stage, {}), **own.get(stage, {})}
    for stage in ("segment", "noise", "calibrate", "diagnose")
}
made = chain.Device(
    name, Path(folder, name), {n: s["kind"] for n, s in own["sessions"].items()},
    gravity=own.get("gravity", 9.80665), nominal=own.get("nominal", {}),
    full_scale=own.get("full_scale", {}), **settings,
)
"""
LOG = "import sys, imuloop; imuloop.calibrate(sys.argv[1], progress=False)"


class Side:
    """One of the two commits: its copy, and a folder with its results."""

    def __init__(self, repository, folder):
        self.repository, self.folder = Path(repository), Path(folder)
        self.folder.mkdir(parents=True)
        # where the configs of a factory have their logs
        (self.folder / "data").symlink_to(self.folder.parent / "data")
        library = str(self.repository / "workflow/lib")
        self.environment = {**os.environ, "PYTHONPATH": library}

    def python(self, *arguments):
        """Return wall and processor seconds of a process of the commit's Python."""
        command = [self.repository / ".venv/bin/python", *arguments]
        return timed_process(command, self.environment, self.folder)[:2]

    def workflow(self, config, work, *arguments):
        """Return wall and processor seconds of the workflow, two jobs at once."""
        where = ("-s", self.repository / "Snakefile", "-d", self.folder / work)
        return self.python("-m", "snakemake", *where, "--configfile", config, "-c2", *arguments)


def copy_of(commit, folder):
    """Return a copy of the repository at a commit, its environment set up."""
    if not folder.exists():
        subprocess.run(["git", "worktree", "add", "--detach", folder, commit], check=True)
    subprocess.run(["make", "-s", "-C", folder, "setup"], check=True)
    return folder


def works(folder):
    """Return the timed work by name, a function of a Side.

    The workflow's runs come first; the stages take their results.
    """
    logs = folder / "data"
    logs.mkdir()
    for number in range(2):
        make_logs(logs, number)
    for number in range(2, MANY):
        for kind in KINDS:
            (logs / f"{device(number)}_{kind}.csv").hardlink_to(logs / f"{device(0)}_{kind}.csv")
    for name, count in (("two", 2), ("many", MANY)):
        (folder / name).mkdir()
        write_config(folder / name, count)
    late = folder / "late.csv"
    record(LATE, "thermometer_lag").write(late)
    two, many = folder / "two/config.yaml", folder / "many/config.yaml"

    def default(side):
        return side.repository / "config.yaml"

    def stage(code, name="d0000", work="two", config=lambda _: two):
        text = f"{STAGE}\n{code}"
        return lambda s: s.python("-c", text, name, s.folder / work / "results", config(s))

    # a folder named `default` Snakemake would take for its profile
    anew = ("--forceall", "--", "results/report.html")
    return {
        "two devices of a factory, all jobs": lambda s: s.workflow(two, "two", *anew),
        f"{MANY} devices, dry run": lambda s: s.workflow(many, "many", "-n"),
        "a log with a late thermometer": lambda s: s.python("-c", LOG, late),
        "diagnosis": stage("chain.diagnose(made)"),
        "config.yaml, all jobs": lambda s: s.workflow(default(s), "whole", *anew),
        "diagnosis of the CATS tag": stage("chain.diagnose(made)", "cats_tag", "whole", default),
    }


def main():
    """Time every work in turns, and publish the ratios."""
    parser = argparse.ArgumentParser(prog="python -m bench.since", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("commit", help="the earlier one")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--folder", type=Path, default=REPOSITORY / "build", help="with room")
    options = parser.parse_args()
    before = copy_of(options.commit, options.folder / f"base_{options.commit}")
    with tempfile.TemporaryDirectory(prefix="since-", dir=options.folder) as folder:
        folder, rows = Path(folder).resolve(), []
        sides = [Side(before, folder / "before"), Side(REPOSITORY, folder / "now")]
        for name, work in works(folder).items():
            took = [[work(side) for side in sides] for _ in range(options.rounds)]
            rows.append((name, *figures(took)))
            print(*rows[-1], sep="; ", file=sys.stderr)
    header = ("work", "before, s", "now, s", "ratio", "spread", "wall, ratio")
    publish("since", f"Beside commit {options.commit}", table(header, rows))


def figures(took):
    """Return median processor seconds of both, their ratio and its spread, ratio of wall time."""
    walls, seconds = zip(*(zip(*pair, strict=True) for pair in took), strict=True)
    before, now = (median(pair) for pair in zip(*seconds, strict=True))
    ratios = [b / a for a, b in seconds]
    wall = median(b for _, b in walls) / median(a for a, _ in walls)
    spread = f"{min(ratios):.2f}–{max(ratios):.2f}"
    return f"{before:.2f}", f"{now:.2f}", f"{now / before:.2f}", spread, f"{wall:.2f}"


if __name__ == "__main__":
    main()
