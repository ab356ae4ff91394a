"""A sound config resolves to plain values."""

import pytest
import yaml

from imuloop.config import fetched, resolve, source_path

SHA = "0" * 64


def test_defaults_are_merged_key_by_key():
    config = {
        "defaults": {"gravity": 9.8, "segment": {"window_s": 2.0, "trim_s": 0.3}},
        "devices": {
            "a": {
                "sessions": {"x": {"kind": "static", "file": "x.csv"}},
                "segment": {"trim_s": 0.0},
            },
            "b": {
                "gravity": {"latitude": 0.0, "height": 0.0},
                "sessions": {"x": {"kind": "static", "file": "x.csv"}},
            },
        },
    }
    devices = resolve(config)
    assert devices["a"]["segment"] == {"window_s": 2.0, "trim_s": 0.0}
    assert devices["b"]["segment"] == {"window_s": 2.0, "trim_s": 0.3}
    assert devices["a"]["gravity"] == 9.8
    # WGS 84, normal gravity at the equator
    assert devices["b"]["gravity"] == pytest.approx(9.7803253359, abs=1e-9)
    assert (devices["a"]["label"], devices["b"]["label"]) == ("a", "b")


def test_bare_time_stamps_resolve_to_text():
    session = "kind: static, file: x.nc, time_range: [2021-09-20 09:00:00, 2021-09-21]"
    config = yaml.safe_load(f"devices: {{imu: {{sessions: {{a: {{{session}}}}}}}}}")
    resolved = resolve(config)["imu"]["sessions"]["a"]
    assert resolved["time_range"] == ["2021-09-20T09:00:00", "2021-09-21"]


def test_one_download_serves_all_sessions_that_name_it():
    source = {"url": "https://a/b/log.csv?raw=1", "sha256": SHA}
    files = {name: {"kind": "static", "file": source} for name in ("x", "y")}
    devices = resolve({"devices": {"a": {"sessions": files}}})
    assert fetched(devices) == {f"{SHA}/log.csv": source}
    assert source_path(source, "data/cache") == f"data/cache/{SHA}/log.csv"
