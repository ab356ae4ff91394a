"""The report of all other devices after a run of the workflow in which jobs failed."""

import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from imuloop import chain
from imuloop.config import resolve
from imuloop.core.errors import ImuloopError, one_line
from imuloop.job_log import last_words

REPORT = "results/report.html"
# an input of the report; it is written after a report that lacks devices, which is then out of date
ATTEMPT = Path("results/.attempt")


@dataclass(frozen=True)
class Failure:
    """Why results of a device, or of all devices together, are missing."""

    device: str  # name of the device; empty for results of all devices together
    label: str  # name in the report
    stage: str  # the rule that failed, with the session
    why: str  # reason in one line
    log: str  # file with the traceback


def report_failed_run(workflow, config, command=f"snakemake -- {REPORT}"):
    """Clean up after a run in which jobs failed; write the report if the run was to write it.

    The results of the failed jobs, and of all jobs that depend on one, are removed. Snakemake would
    take them for results of this run and not try again. The report has the complete devices, and
    for each other device the stage that failed.

    Parameters
    ----------
    workflow : snakemake.workflow.Workflow
        The object of that name in a Snakefile.
    config : dict
        Config of imuloop.
    command : str
        Command that makes the report, to be shown in it.

    Returns
    -------
    list of str
        A line for each failed job; empty if none failed, as after Ctrl-C.
    """
    dag, causes = workflow.dag, {}
    # on a cluster the jobs of a device fail as a group
    failed = [job for each in workflow.scheduler.failed for job in getattr(each, "jobs", [each])]
    for cause in failed:
        waiting = {cause}
        while waiting:
            job = waiting.pop()
            causes.setdefault(job, []).append(cause)
            waiting |= {each for each in dag.depending[job] if cause not in causes.get(each, ())}
    for job in causes:
        for path in map(Path, job.output):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    sentence = "{} failed: {} (more in {})"
    lines = [sentence.format(*_explain([job], *job.wildcards)) for job in failed]
    makers = {str(path): job for job in dag.jobs for path in job.output}
    report = makers.get(REPORT)
    if report in causes and report not in failed:
        devices = resolve(config)
        failures = []
        for name, device in devices.items():
            job = makers[f"results/{name}/section.html"]
            if job in causes:
                failures.append(Failure(name, device["label"], *_explain(causes[job])))
            elif dag.needrun(job) and not dag.finished(job):
                why = "the run stopped before this stage", job.log[0]
                failures.append(Failure(name, device["label"], job.rule.name, *why))
        failures = failures or [Failure("", "All devices", *_explain(failed))]
        try:
            chain.report(devices, command, failures=failures)
            ATTEMPT.write_text(f"{time.time_ns()}\n")
        except (ImuloopError, OSError) as error:
            lines.append(f"report failed: {one_line(error)}")
    return lines


def _explain(jobs, *words):
    """Return stage, reason and path of the log of a failed job: the first whose log has a reason.

    `jobs` are failed jobs. The stage is the rule with `words`, by default with the session.
    """
    job = next((job for job in jobs if last_words(job.log[0])), jobs[0])
    why = last_words(job.log[0]) or "no message: killed, or no memory or no room on the disk left"
    words = words or filter(None, [getattr(job.wildcards, "session", "")])
    return " ".join([job.rule.name, *words]), one_line(why), job.log[0]
