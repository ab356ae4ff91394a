"""A sensor's folder of an EuRoC recording: `imu0` with `data.csv` and `sensor.yaml`."""

from pathlib import Path

from imuloop.core.errors import RejectedLog
from imuloop.ingest import delimited

TABLE = "data.csv"


def read(paths, columns=None, batch_rows=1 << 16):
    """Read the table in the folder, or the table alone, as `imuloop.ingest.delimited.read` does.

    Its header gives names and units.

    Raises
    ------
    RejectedLog
        If the folder holds no table.
    """
    path = Path(paths["log"])
    path = path / TABLE if path.is_dir() else path
    if not path.is_file():
        raise RejectedLog(f"the folder holds no {TABLE}")
    return delimited.read({"log": path}, columns, batch_rows)
