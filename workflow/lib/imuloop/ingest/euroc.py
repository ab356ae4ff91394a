"""A sensor's folder of an EuRoC recording: `imu0` with `data.csv` and `sensor.yaml`."""

from pathlib import Path

from imuloop.core.errors import RejectedLog
from imuloop.ingest import delimited

TABLE = "data.csv"


def read(paths, columns=None, batch_rows=1 << 16):
    """Read the table in the folder; its header gives names and units.

    Parameters
    ----------
    paths : dict
        ``{"log": path}``, the folder or its table.
    columns : dict, optional
        Quantity to columns, as of any text table.
    batch_rows : int
        Rows given at once.

    Raises
    ------
    ImuloopError
        If a declared column is not there.
    RejectedLog
        If the folder holds no table.
    """
    path = Path(paths["log"])
    if path.is_dir():
        path = path / TABLE
    if not path.is_file():
        raise RejectedLog(f"the folder holds no {TABLE}")
    return delimited.read({"log": path}, columns, batch_rows)
