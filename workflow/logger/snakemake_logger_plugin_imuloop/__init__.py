"""Snakemake's log in a line per device and stage, with a bar over the jobs: ``--logger imuloop``.

Snakemake finds it by the name of its folder where ``workflow/logger`` is in the path of Python.
"""

import logging
import sys
from collections import Counter

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent
from tqdm import tqdm

# events that are more than a line to a person
UNSAID = set(LogEvent) - {LogEvent.ERROR, LogEvent.JOB_ERROR, LogEvent.GROUP_ERROR}


class LogHandler(LogHandlerBase):
    """Writes which stage of which device is done; faults as Snakemake has them."""

    writes_to_stream, writes_to_file = True, False
    has_filter = has_formatter = needs_rulegraph = False

    def __post_init__(self):
        """Begin without jobs."""
        # rule and wildcards of each job, and how many sessions of a device each stage has done
        self.jobs, self.sessions = {}, {}
        # shown on a terminal alone
        self.bar = tqdm(total=0, disable=None, leave=False, unit="job")

    def emit(self, record):
        """Say what a record tells of a job."""
        event = getattr(record, "event", None)
        if event == LogEvent.JOB_INFO:
            self.jobs[record.jobid] = record.rule_name, dict(record.wildcards)
        elif event == LogEvent.JOB_FINISHED:
            self._finished(*self.jobs[record.job_id])
        elif event == LogEvent.PROGRESS:
            self.bar.total = record.total
            self.bar.update(record.done - self.bar.n)
        elif event not in UNSAID and record.levelno >= logging.WARNING:
            self._say(self.format(record))

    def _finished(self, stage, wildcards):
        """Say that a stage of a device is done; those of its sessions before the next stage."""
        device = wildcards.get("device") or wildcards.get("replica")
        waiting = self.sessions.setdefault(device, Counter())
        if "session" in wildcards:
            waiting[stage] += 1
            return
        for of_sessions, count in waiting.items():
            self._say(f"{device}  {of_sessions}  {count} session{'s' * (count > 1)}")
        waiting.clear()
        if device:
            self._say(f"{device}  {stage}")

    def _say(self, line):
        self.bar.write(line, file=sys.stderr)

    def close(self):
        """Take the bar away."""
        self.bar.close()
        super().close()
