"""The report on the complete devices after a run of the workflow in which jobs failed.

Snakemake removes the outputs of a job that failed. So the first output of a device that is missing
names the job, and the log of that job has the reason.
"""

import time
from dataclasses import dataclass
from pathlib import Path

from imuloop import chain
from imuloop.config import resolve, source_path
from imuloop.core.errors import ImuloopError, one_line
from imuloop.file_faults import SIMULATED
from imuloop.job_log import INTERRUPTED, last_words

REPORT = "results/report.html"
# an input of the report; it is written after a report that lacks devices, which is then out of date
ATTEMPT = Path("results/.attempt")
KILLED = "no message: killed, or no memory or no room on the disk left"
# an output of each stage, in their order; the output of a session has the name of the session
OUTPUTS = {
    "ingest": "{session}/samples.parquet",
    "segment": "{session}/segments.parquet",
    "noise": "noise.json",
    "calibrate": "multi_position.json",
    "diagnose": "diagnosis.json",
    "allan": "{session}/allan.parquet",
    "report_device": "section.html",
}


@dataclass(frozen=True)
class Failure:
    """Why results of one device, or of all devices together, are missing after a run."""

    device: str  # name of the device; empty for results of all devices together
    label: str  # name in the report
    stage: str  # the rule that failed, with the session
    why: str  # reason in one line
    log: str  # file with the traceback

    def __str__(self):
        stage, *session = self.stage.split()
        name = " ".join(filter(None, [stage, self.device, *session]))
        return f"{name} failed: {self.why} (more in {self.log})"


def report_failed_run(config, command=f"snakemake -- {REPORT}", asked=True):
    """Write the report after a run in which jobs failed.

    The report has the complete devices, and for each other device the stage that failed. A device
    that failed loses its part of the report: Snakemake would take a part that an earlier run made
    for a result of this run, and not try again.

    Parameters
    ----------
    config : dict
        The config of the run, without faults.
    command : str
        Command that makes the report, to be shown in it.
    asked : bool
        Whether the run was meant to write the report.

    Returns
    -------
    list of str
        A line for each failed job; empty if none failed, as after Ctrl-C.
    """
    devices = resolve(config)
    of_devices = [_failure(name, device, config) for name, device in devices.items()]
    failures = [failure for failure in of_devices if failure]
    of_all = []
    for stage, path in (("family", "results/family.json"), ("report", REPORT)):
        log = Path(f"logs/{stage}/{stage}.log")
        # if a device failed, this job did not start, and its log is that of an earlier run
        why = last_words(log) or (KILLED if log.exists() and not failures else "")
        if why and not Path(path).exists():
            of_all.append(Failure("", "All devices", stage, why, str(log)))
    lines = [str(failure) for failure in (*failures, *of_all) if failure.why != INTERRUPTED]
    for failure in failures:
        Path("results", failure.device, "section.html").unlink(missing_ok=True)
    if asked and lines and "report" not in {failure.stage for failure in of_all}:
        try:
            chain.report(devices, command, failures=failures or of_all)
            ATTEMPT.write_text(f"{time.time_ns()}\n")
        except (ImuloopError, OSError) as error:
            lines.append(f"report failed: {one_line(error)}")
    return lines


def _failure(name, device, config):
    """Return the Failure of a device, or None if its part of the report is up to date.

    The stage that failed is the first in the order of `OUTPUTS` whose output is missing. If no
    output is missing, but a log or a result is newer than the part of the report, the stage that
    failed is `report_device`. `name` is the name of the device, `device` the device as `resolve`
    returns it, and `config` the config.
    """
    for stage, pattern in OUTPUTS.items():
        for session, plan in device["sessions"].items() if "{" in pattern else [("", {})]:
            if Path("results", name, pattern.format(session=session)).exists():
                continue
            log = f"logs/{stage}/{'/'.join(filter(None, [name, session]))}.log"
            if stage == "ingest":
                stage, session, log = _source(plan, config) or (stage, session, log)
            # a job without a log did not start
            why = last_words(log) or (KILLED if Path(log).exists() else INTERRUPTED)
            return Failure(name, device["label"], f"{stage} {session}".strip(), why, log)
    # a log or a result that is newer than the part of the report was not used for it
    sources = (s for plan in device["sessions"].values() for s in plan["sources"].values())
    logs = (source_path(source, config.get("cache", "data/cache")) for source in sources)
    results = (
        Path("results", name, pattern.format(session=session))
        for pattern in OUTPUTS.values()
        for session in device["sessions"]
    )
    finished = Path("results", name, OUTPUTS["report_device"]).stat().st_mtime
    files = (path for path in (*map(Path, logs), *results) if path.exists())
    if any(path.stat().st_mtime > finished for path in files):
        log = f"logs/report_device/{name}.log"
        return Failure(name, device["label"], "report_device", INTERRUPTED, log)
    return None


def _source(session, config):
    """Return rule, name and log file of the job that should have made a missing log, or None.

    The three are texts, and the job is the one for the first file of the session that is missing.
    Only logs that are fetched or simulated come from a job. If no such log is missing, the result
    is None. `session` is a session as `resolve` returns it, and `config` the config.
    """
    for source in session["sources"].values():
        path = source_path(source, config.get("cache", "data/cache"))
        if simulated := SIMULATED.fullmatch(path):
            rule, name = "simulate", "/".join(simulated.groups())
        else:
            rule, name = "ingest_fetch", "/".join(Path(path).parts[-2:])
        if not Path(path).exists() and (simulated or "path" not in source):
            return rule, name, f"logs/{rule}/{name}.log"
    return None
