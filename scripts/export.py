"""Write one device's calibration and noise in other tools' formats."""

from imuloop.export.export import export_files, read_exported, write_exports
from imuloop.job_log import open_log

params, given, output = snakemake.params, snakemake.input, snakemake.output
open_log(snakemake.log[0], f"export {params.device}")

exported = read_exported(params.device, params.label, given.calibration, given.noise, given.quality)
write_exports(output.exports, export_files(exported))
