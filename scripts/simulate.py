"""Make one log of a simulated device."""

from imuloop.job_log import open_log
from imuloop.simulate.simulate import log_metadata, simulate_session, write_log
from imuloop.simulate.truth import read_truth

session = snakemake.params.session
open_log(snakemake.log[0], f"simulate {snakemake.wildcards.replica}/{session}")

truth = read_truth(snakemake.input[0])
write_log(snakemake.output[0], simulate_session(truth, session), log_metadata(truth, session))
