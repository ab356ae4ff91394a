"""Make one log of a simulated device."""

from imuloop.job_log import open_log
from imuloop.simulate.simulate import log_metadata, simulate_session, write_log
from imuloop.simulate.truth import read_truth

recording = snakemake.params.recording
open_log(snakemake.log[0], f"simulate {snakemake.wildcards.replica}/{recording}")

truth = read_truth(snakemake.input[0])
write_log(snakemake.output[0], simulate_session(truth, recording), log_metadata(truth, recording))
