"""Compare the devices of a board: their frames, and whose an error is."""

from pathlib import Path

from imuloop.chain import Device, board
from imuloop.job_log import run_stage

folder = Path(snakemake.output.board).parent
made = Device(folder.name, folder, {}, log=snakemake.log[0])
devices = [
    Device(**each, folder=folder.parents[1] / each["name"]) for each in snakemake.params.devices
]
run_stage(board, made, devices)
