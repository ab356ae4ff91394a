"""Compare the devices of each type."""

from pathlib import Path

from imuloop.family.family import read_member, write_family
from imuloop.job_log import open_log

open_log(snakemake.log[0], "family")

folder = Path(snakemake.output.family).parent
types = {
    kind: [read_member(folder / name) for name in names]
    for kind, names in snakemake.params.types.items()
}
write_family(snakemake.output.family, types)
