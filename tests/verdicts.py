"""The stages of a device to its diagnosis, without what takes longest: no verdict hangs on it."""

from unittest.mock import patch

from bench.study.chain import ATTITUDE, LIMITS
from imuloop import chain
from imuloop.core.files import read_json
from imuloop.validate.attitude import no_attitude


def diagnosed(folder, log=None, kind="multi_position", name="log", **settings):
    """Return the diagnosis of both sensors, of a log or of what is ingested in the folder."""
    device = chain.Device("imu", folder, {name: kind}, **settings)
    attitude = no_attitude("imu", "not asked for")
    with patch(LIMITS, return_value={}), patch(ATTITUDE, return_value=attitude):
        if log is not None:
            folder.mkdir(exist_ok=True)
            log.to_parquet(folder / "log.parquet", index=False)
            assert chain.ingest(device, name, {}, [folder / "log.parquet"]) == []
        for stage in (chain.segment, chain.noise, chain.calibrate, chain.diagnose):
            assert stage(device) == []
    return read_json(folder / "diagnosis.json")["sensors"]
