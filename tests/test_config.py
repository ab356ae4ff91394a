"""A sound config resolves to plain values."""

import pytest
import yaml

from imuloop.config import fetched, resolve, source_path

SHA = "0" * 64


def test_defaults_are_merged_key_by_key():
    sessions = {"x": {"kind": "static", "file": "x.csv"}}
    keys_of = {
        "a": {"segment": {"guard_s": 0.0}},
        "b": {"gravity": {"latitude": 0.0, "height": 0.0}},
    }
    devices = {name: {"sessions": sessions} | keys for name, keys in keys_of.items()}
    defaults = {"gravity": 9.8, "segment": {"window_s": 2.0, "guard_s": 0.3}}
    devices = resolve({"defaults": defaults, "devices": devices})
    assert devices["a"]["segment"] == {"window_s": 2.0, "guard_s": 0.0}
    assert devices["b"]["segment"] == {"window_s": 2.0, "guard_s": 0.3}
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


def sessions_of(text):
    return resolve(yaml.safe_load(text))["imu"]["sessions"]


def test_what_holds_for_all_logs_is_said_once(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sessions = sessions_of("""
        defaults: {rate: 100, columns: {time: null}}
        devices:
          imu:
            columns: {acceleration: [1, 2, 3]}
            units: {acceleration: g, angular_rate: deg/s}
            sessions:
              a: {kind: static, file: a.csv}
              b: {kind: static, file: b.csv, rate: 50, units: {acceleration: mg}}
    """)
    assert sessions["a"]["columns"] == {"time": None, "acceleration": [1, 2, 3]}
    assert sessions["a"]["units"] == {"acceleration": "g", "angular_rate": "deg/s"}
    assert sessions["b"]["units"] == {"acceleration": "mg", "angular_rate": "deg/s"}
    assert (sessions["a"]["rate"], sessions["b"]["rate"]) == (100, 50)


@pytest.mark.parametrize("file", ["logs", "logs/*.csv", "logs/2*-?.csv"])
def test_each_file_of_a_folder_or_a_pattern_is_a_session_named_by_it(tmp_path, monkeypatch, file):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "logs").mkdir()
    for name in ("2026-1.csv", "2026-2.csv", ".hidden.csv", *["night.csv"] * ("2" not in file)):
        (tmp_path / "logs" / name).write_text("t,ax,ay,az,gx,gy,gz\n")
    text = f"devices: {{imu: {{sessions: {{poses: {{kind: multi_position, file: {file!r}}}}}}}}}"
    sessions = sessions_of(text)
    expected = {"poses_2026-1": "logs/2026-1.csv", "poses_2026-2": "logs/2026-2.csv"}
    expected |= {} if "2" in file else {"night": "logs/night.csv"}
    assert {
        name: session["sources"]["log"]["path"] for name, session in sessions.items()
    } == expected
    assert {session["kind"] for session in sessions.values()} == {"multi_position"}


def test_files_of_one_stem_are_sessions_of_two_names(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("b.csv", "b.log", "exports.csv"):
        (tmp_path / name).write_text("t,ax,ay,az,gx,gy,gz\n")
    text = "devices: {imu: {sessions: {b: {kind: static, file: '*.*'}}}}"
    assert list(sessions_of(text)) == ["b", "b_b", "b_exports"]
