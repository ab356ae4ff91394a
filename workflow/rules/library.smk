"""The library in the path of every script, on a cluster too, before one that is installed."""

import os
import sys
from pathlib import Path


def end_with(faults):
    """End the run with faults of the config, a line each, if there are any.

    Around an exception Snakemake would print where it was raised.
    """
    if faults:
        print(*faults, sep="\n", file=sys.stderr)
        sys.exit(1)


rules_folder = workflow.current_basedir
if hasattr(rules_folder, "hosted_repo"):
    # of a module by github() Snakemake has single files: all of them come out of its clone
    clone = rules_folder.hosted_repo.repo
    commit = clone.commit(rules_folder.ref).hexsha
    checkout = Path(".snakemake/imuloop", commit).absolute()
    if not checkout.exists():
        clone.git.worktree("add", "--force", "--detach", checkout, commit)
    rules_folder = checkout / "workflow/rules"

library = str(Path(str(rules_folder)).with_name("lib"))
sys.path.insert(0, library)
# a script has the path of its own Python first
others = os.environ.get("PYTHONPATH")
os.environ |= {"PYTHONPATH": os.pathsep.join(filter(None, [library, others]))}
