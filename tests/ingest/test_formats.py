"""What tells a format: its name in the config, a file's first bytes, its name."""

import pytest

from imuloop.core.errors import ImuloopError
from imuloop.ingest.formats import FORMATS, SIGNATURES, find_format, guess_format


@pytest.mark.parametrize(("head", "name"), SIGNATURES.items())
def test_first_bytes_go_before_the_name(tmp_path, head, name):
    path = tmp_path / "log.csv"
    path.write_bytes(head + bytes(100))
    assert guess_format({"log": str(path)}) == name
    path.write_bytes(head[:-1])
    assert guess_format({"log": str(path)}) == "csv"


def test_a_table_of_sensorlog_is_known_by_its_header(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("loggingTime(txt),accelerometerTimestamp_sinceReboot(s),a\n1,2,3\n")
    assert guess_format({"log": path}) == "csv"
    path.write_text("accelerometerTimestamp_sinceReboot(s),accelerometerAccelerationX(G)\n1,2\n")
    assert guess_format({"log": path}) == "sensorlog"


def test_the_config_goes_before_all(log, run, tmp_path):
    path = tmp_path / "log.parquet"
    log.to_csv(path, index=False)
    assert find_format("csv", {"log": path}) == ("csv", FORMATS["csv"])
    assert run(path, format="csv").quality["log_format"] == "csv"


def test_a_file_that_is_not_there_is_known_by_its_name():
    assert guess_format({"log": "data/of/tomorrow.ULG"}) == "ulog"
    assert guess_format({"acceleration": "a.mat", "angular_rate": "b.mat"}) == "imu_tk"
    with pytest.raises(ImuloopError, match="does not say its format"):
        guess_format({"log": "log.unknown"})
