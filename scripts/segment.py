"""Cut one session into rests, motion, disturbances and gaps."""

from imuloop.core.samples import Columns
from imuloop.core.segments import write_segments
from imuloop.job_log import open_log
from imuloop.segment.segment import session_columns
from imuloop.segment.settings import SegmentSettings

wildcards, params = snakemake.wildcards, snakemake.params
open_log(snakemake.log[0], f"segment {wildcards.device}/{wildcards.session}")

segments, metadata = session_columns(
    Columns(snakemake.input.samples),
    params.kind,
    SegmentSettings(**params.settings),
    snakemake.threads,
)
write_segments(snakemake.output[0], segments, metadata)
