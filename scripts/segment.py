"""Cut each session of one device into rests, motion, disturbances and gaps."""

from imuloop.core.samples import Columns
from imuloop.core.segments import write_segments
from imuloop.job_log import open_log
from imuloop.segment.segment import session_columns
from imuloop.segment.settings import SegmentSettings

params = snakemake.params
open_log(snakemake.log[0], f"segment {params.device}")

settings = SegmentSettings(**params.settings)
for each, path in zip(params.sessions.values(), snakemake.output, strict=True):
    samples = Columns(each["samples"])
    write_segments(path, *session_columns(samples, each["kind"], settings, snakemake.threads))
