"""Cut one session into rests, motion, disturbances and gaps."""

from imuloop.core.samples import read_samples
from imuloop.core.segments import write_segments
from imuloop.job_log import open_log
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings

wildcards, params = snakemake.wildcards, snakemake.params
open_log(snakemake.log[0], f"segment {wildcards.device}/{wildcards.session}")

segments, metadata = segment_session(
    read_samples(snakemake.input.samples), params.kind, SegmentSettings(**params.settings)
)
write_segments(snakemake.output[0], segments, metadata)
