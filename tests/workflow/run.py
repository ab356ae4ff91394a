"""The workflow run as a user runs it."""

import gc
import os
import subprocess
import sys
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

# of a process that has imported once what Snakemake needs in every call
FORKS = get_context("forkserver")
FORKS.set_forkserver_preload(
    ["snakemake.cli", "pandas", "pyarrow.parquet", "scipy.signal", "pydantic"]
)


def words(repository, folder, *arguments, target="results/report.html", config="config.yaml"):
    snakefile = Path(repository) / "Snakefile"
    options = ["-s", snakefile, "-d", folder, "-c2", *(["--configfile", config] if config else [])]
    return [str(w) for w in (*options, *arguments, *(["--", *target.split()] if target else []))]


def command(repository, folder, *arguments, **how):
    return [sys.executable, "-m", "snakemake", *words(repository, folder, *arguments, **how)]


def snakemake(
    repository,
    folder,
    *arguments,
    target="results/report.html",
    config="config.yaml",
    cwd=None,
    **environment,
):
    """Run the workflow of a repository in a folder; return the finished process."""
    variables = {key: value for key, value in os.environ.items() if key != "IMULOOP_MIRROR"}
    run = words(repository, folder, *arguments, target=target, config=config)
    return run_fork(run, cwd or folder, variables | environment)


def run_fork(arguments, cwd, env):
    """Run Snakemake in a fork, which spares its imports; return what ``subprocess.run`` would."""
    with TemporaryDirectory() as folder:
        printed = [Path(folder, name) for name in ("stdout", "stderr")]
        process = FORKS.Process(target=_in_fork, args=(arguments, cwd, env, printed))
        process.start()
        process.join()
        texts = [path.read_text() for path in printed]
    return subprocess.CompletedProcess(arguments, process.exitcode, *texts)


def _in_fork(arguments, cwd, env, printed):
    from snakemake.cli import main

    for stream, path in enumerate(printed, 1):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), stream)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(env)
    # a sixth of its time, and it ends soon
    gc.disable()
    main(arguments)
