"""Faults of a config: all of them, one a line, each with its key and the remedy."""

import pytest
import yaml

from entries import REPLICAS, SOUND, session
from imuloop.config import merge
from imuloop.config_faults import config_faults

SHA = "0" * 64
MOVED, BODY = "kind: reference_motion, file: poses.csv", "convention: body_to_world"


def test_smallest_entry_works(faults):
    assert (
        faults("devices:\n  my_imu:\n    sessions:\n      a: {kind: static, file: poses.csv}") == []
    )


@pytest.mark.parametrize("name", ["config.yaml", "config/measured.yaml", "config/reference.yaml"])
def test_shipped_configs_have_no_fault(repository, schema, name, monkeypatch):
    monkeypatch.chdir(repository)
    replicas = {
        path.stem: list(yaml.safe_load(path.read_text())["sessions"])
        for path in repository.glob("data/replicas/*.yaml")
    }
    path = repository / name
    assert config_faults(yaml.safe_load(path.read_text()), {name: path}, schema, replicas) == []


ONE_FAULT = {
    "unit": (
        session(f"{SOUND}, units: {{time: sec}}"),
        "devices.imu.sessions.a.units.time: 'sec' is not a unit; did you mean 's'?",
    ),
    "unit of all logs": (
        session(SOUND, "units: {time: sec},"),
        "devices.imu.units.time: 'sec' is not a unit; did you mean 's'?",
    ),
    "kind": (
        session("kind: statc, file: poses.csv"),
        "devices.imu.sessions.a.kind: 'statc' is not a kind of session; did you mean 'static'?",
    ),
    "no reference": (
        session("kind: reference_motion, file: poses.csv"),
        "devices.imu.sessions.a.reference: missing; a needs it",
    ),
    "reference of another kind": (
        session(f"{SOUND}, reference: {{columns: {{orientation: [a, b, c, d]}}, {BODY}}}"),
        "devices.imu.sessions.a.reference: only a session of kind reference_motion has one",
    ),
    "convention": (
        session(
            f"{MOVED}, reference: {{columns: {{orientation: [0, 1, 2, 3]}}, "
            "convention: body_to_wolrd}}".replace("}}", "}")
        ),
        "devices.imu.sessions.a.reference.convention: 'body_to_wolrd' is not a convention; did you "
        "mean 'body_to_world'?",
    ),
    "column of a reference": (
        session(f"{MOVED}, reference: {{columns: {{orientation: [qw, ax, ay, az]}}, {BODY}}}"),
        "devices.imu.sessions.a.reference.columns.orientation: no column 'qw'; there are t, ax, "
        "ay, az, gx, gy, gz, note",
    ),
    "known rotation without an angle": (
        session("kind: known_rotation, file: poses.csv, axis: x"),
        "devices.imu.sessions.a.angle: missing; a needs it",
    ),
    "format": (
        session(f"{SOUND}, format: netcdf4"),
        "devices.imu.sessions.a.format: 'netcdf4' is not a format; did you mean 'netcdf'?",
    ),
    "unknown key": (
        session(SOUND, "lable: x,"),
        "devices.imu.lable: unknown key; did you mean 'label'?",
    ),
    "view": (
        session(SOUND, "noise: {views: [psd, hadamrd]},"),
        "devices.imu.noise.views.1: 'hadamrd' is not a view of the noise; did you mean 'hadamard'?",
    ),
    "missing key": (session("file: poses.csv"), "devices.imu.sessions.a.kind: missing; a needs it"),
    "nothing": (session(SOUND, "label: ,"), "devices.imu.label: nothing is given"),
    "no devices": ("devices: {}", "devices: empty"),
    "device name": (
        "devices: {1imu: {sessions: {a: {kind: static, file: poses.csv}}}}",
        "devices.1imu: '1imu' is not a name (a letter, then up to 63 letters, digits, _ or -)",
    ),
    "reserved name": (
        "devices: {imu: {sessions: {exports: {kind: static, file: poses.csv}}}}",
        "devices.imu.sessions.exports: 'exports' is reserved for a folder of results; "
        "name the session otherwise",
    ),
    "type": (
        session(SOUND, "type: 2nd,"),
        "devices.imu.type: '2nd' is not a name (a letter, then up to 63 letters, digits, _ or -)",
    ),
    "board": (
        session(SOUND, "board: 2nd,"),
        "devices.imu.board: '2nd' is not a name (a letter, then up to 63 letters, digits, _ or -)",
    ),
    "reserved for all": (
        "devices: {figures: {sessions: {a: {kind: static, file: poses.csv}}}}",
        "devices.figures: 'figures' is reserved for pictures of all; name it otherwise",
    ),
    "reserved device": (
        "devices: {boards: {board: wing, sessions: {a: {kind: static, file: poses.csv}}}}",
        "devices.boards: 'boards' is reserved where a device names a board; name it otherwise",
    ),
    "missing file": (
        session("kind: static, file: data/none.csv"),
        "devices.imu.sessions.a.file: there is no file data/none.csv",
    ),
    "replica": (
        session("kind: static, file: data/simulated/iphone6/static.parquet"),
        "devices.imu.sessions.a.file: there is no replica 'iphone6'; did you mean 'iphone_6'?",
    ),
    "hash": (
        session("kind: static, file: {url: 'https://a/b.csv', sha256: abc}"),
        "devices.imu.sessions.a.file.sha256: 'abc' is not a SHA-256 (64 digits 0-9 a-f)",
    ),
    "format of two files": (
        session(f"{SOUND}, format: imu_tk"),
        "devices.imu.sessions.a.file: format imu_tk is read from acceleration and angular_rate, "
        "given log",
    ),
    "counts": (
        session(f"{SOUND}, units: {{acceleration: count}}"),
        "devices.imu.sessions.a.units.acceleration: "
        "'count' needs the device's nominal.acceleration",
    ),
    "one text for three": (
        session(f"{SOUND}, columns: {{acceleration: acc}}"),
        "devices.imu.sessions.a.columns.acceleration: 'acc' is not a list of three columns x, y, z",
    ),
    "unknown column": (
        session(f"{SOUND}, columns: {{acceleration: [ax, ay, azz]}}"),
        "devices.imu.sessions.a.columns.acceleration: no column 'azz'; "
        "there are t, ax, ay, az, gx, gy, gz, note; did you mean 'az'?",
    ),
    "no clock": (
        session(
            "kind: static, file: bare.csv, "
            "columns: {acceleration: [0, 1, 2], angular_rate: [3, 4, 5]}"
        ),
        "devices.imu.sessions.a.rate: missing; bare.csv has no time column of a usual name "
        "(no header, 6 columns); give it, or name the column in columns.time",
    ),
    "range order": (
        session(f"{SOUND}, time_range: [5, 1]"),
        "devices.imu.sessions.a.time_range: the start is not before the end",
    ),
    "a date for a clock without": (
        session(f"{SOUND}, time_range: ['2021-09-20T10:00', null]"),
        "devices.imu.sessions.a.time_range: '2021-09-20T10:00' is a date, but the log's stamps "
        "are not; give seconds",
    ),
    "time that is none": (
        session(f"{SOUND}, columns: {{time: note}}"),
        "devices.imu.sessions.a.file: time column 'note' holds neither numbers nor ISO 8601 "
        "stamps; name the right one in columns.time",
    ),
    "counts by the log's word": (
        session("kind: static, file: counts.csv"),
        "devices.imu.sessions.a.file: acceleration in counts needs nominal.acceleration.scale "
        "and .offset",
    ),
    "gravity": (
        session(SOUND, "gravity: 98,"),
        "devices.imu.gravity: 98 is greater than the maximum of 9.9",
    ),
    "in the defaults": (session(SOUND) + "\ndefaults: {label: 3}", "defaults.label: 3 is not text"),
    "mirror": (session(SOUND) + "\nmirror: nowhere", "mirror: there is no folder nowhere"),
    "twice": (
        "devices:\n  imu: {sessions: {a: {kind: static, file: poses.csv}}}\n"
        "  imu: {sessions: {a: {kind: static, file: poses.csv}}}",
        "devices.imu: given twice (again in line 3); only one would count",
    ),
    "1e-3": (
        session(SOUND, "full_scale: {acceleration: 1e3},"),
        "devices.imu.full_scale.acceleration: 1e3 is text to YAML, no number; write 1.0e+3",
    ),
    "on": (
        session(SOUND, "label: on,"),
        "devices.imu.label: on is true to YAML; write 'on' with quotes, or true",
    ),
    "12:30:00": (
        session(f"{SOUND}, time_range: [12:30:00, 50000]"),
        "devices.imu.sessions.a.time_range.0: 12:30:00 is 45000 to YAML; "
        "write '12:30:00' with quotes, or 45000",
    ),
    "a column twice": (
        session(f"{SOUND}, columns: {{acceleration: [ax, ax, az]}}"),
        "devices.imu.sessions.a.columns.acceleration: ['ax', 'ax', 'az'] names a column twice",
    ),
}


@pytest.mark.parametrize(("text", "line"), ONE_FAULT.values(), ids=ONE_FAULT)
def test_a_fault_names_its_key_and_the_remedy(faults, text, line):
    assert faults(text) == [line]


def test_faults_are_named_all_at_once(faults):
    text = f"""
    defaults: {{noise: {{significance: 2}}}}
    devices:
      a: {{sessions: {{x: {{kind: static, file: none.csv, units: {{time: sec}}}}}}}}
      b: {{gravity: 1e1, sessions: {{y: {{{SOUND}, rates: 3}}}}}}
    """
    assert {line.split(": ")[0] for line in faults(text)} == {
        "defaults.noise.significance",
        "devices.a.sessions.x.file",
        "devices.a.sessions.x.units.time",
        "devices.b.gravity",
        "devices.b.sessions.y.rates",
    }


def test_one_wrong_unit_does_not_hide_another(faults):
    lines = faults(session(f"{SOUND}, units: {{time: sec, acceleration: count}}"))
    assert [line.partition(": ")[0] for line in lines] == [
        "devices.imu.sessions.a.units.time",
        "devices.imu.sessions.a.units.acceleration",
    ]


def test_all_columns_that_are_not_there_are_named(faults):
    columns = "{time: stamp, acceleration: [fx, ay, az], angular_rate: [gx, gy, rz]}"
    keys = [line.split(": ")[0] for line in faults(session(f"{SOUND}, columns: {columns}"))]
    assert keys == [
        f"devices.imu.sessions.a.columns.{quantity}"
        for quantity in ("time", "acceleration", "angular_rate")
    ]


@pytest.mark.parametrize(
    ("quantity", "written", "hint"),
    [
        ("angular_rate", "dps", "did you mean 'deg/s'?"),
        ("angular_rate", "mdps", "use one of rad/s, deg/s, mrad/s, deg/h, count, rad, mrad, deg"),
        ("time", "µs", "did you mean 'us'?"),
        ("acceleration", "m/s²", "did you mean 'm/s^2'?"),
        ("temperature", "°C", "did you mean 'degC'?"),
    ],
)
def test_a_unit_is_never_mistaken_for_another_by_its_letters(faults, quantity, written, hint):
    [line] = faults(session(f"{SOUND}, units: {{{quantity}: '{written}'}}"))
    assert line.endswith(f"'{written}' is not a unit; {hint}")


def test_a_column_is_taken_once(faults):
    for columns, line in (
        ("acceleration: [1, ax, 3]", "acceleration: column 1, 'ax', is already in "
         "columns.acceleration; name another"),
        ("angular_rate: [ax, gy, gz]", "angular_rate: column 1, 'ax', is already in "
         "columns.acceleration; name another"),
        ("temperature: t", "temperature: column 0, 't', is already in columns.time; name another"),
    ):  # fmt: skip
        assert faults(session(f"{SOUND}, columns: {{{columns}}}")) == [
            f"devices.imu.sessions.a.columns.{line}"
        ]


def test_a_fault_of_the_defaults_is_named_once(faults):
    one = f"{{sessions: {{x: {{{SOUND}}}}}}}"
    assert len(faults(f"devices: {{a: {one}, b: {one}}}\ndefaults: {{gravity: 98}}")) == 1


def test_a_fault_names_the_file_that_holds_it(tmp_path, schema, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "poses.csv").write_text("t,ax,ay,az,gx,gy,gz\n0,0,0,9.8,0,0,0\n")
    first = {"devices": {"a": {"sessions": {"x": {"kind": "static", "file": "poses.csv"}}}}}
    second = {"devices": {"a": {"label": 3}}}
    files = {name: tmp_path / name for name in ("first.yaml", "second.yaml")}
    for path, content in zip(files.values(), (first, second), strict=True):
        path.write_text(yaml.safe_dump(content))
    lines = config_faults(merge(first, second), files, schema, REPLICAS)
    assert lines == ["second.yaml: devices.a.label: 3 is not text"]
