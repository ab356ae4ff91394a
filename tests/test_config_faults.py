"""Faults of a config: all of them, one a line, each with its key and the remedy."""

import pytest
import yaml

from entries import REPLICAS, SOUND, session
from imuloop.config import merge
from imuloop.config_faults import config_faults


def test_smallest_entry_works(faults):
    assert (
        faults("devices:\n  my_imu:\n    sessions:\n      a: {kind: static, file: poses.csv}") == []
    )


@pytest.mark.parametrize("name", ["config.yaml", "config/measured.yaml", "config/reference.yaml"])
def test_shipped_configs_have_no_fault(repository, name, monkeypatch):
    monkeypatch.chdir(repository)
    replicas = {
        path.stem: list(yaml.safe_load(path.read_text())["sessions"])
        for path in repository.glob("data/replicas/*.yaml")
    }
    path = repository / name
    assert config_faults(yaml.safe_load(path.read_text()), {name: path}, replicas) == []


# declarations and, below each, its fault: for a session, with a file where none is named; for a
# device
SESSION = """
    units: {time: sec}
    units.time: 'sec' is not a unit; did you mean 's'?
    kind: statc, file: poses.csv
    kind: 'statc' is not a kind; did you mean 'static'?
    kind: reference_motion, file: poses.csv
    reference: missing; a session of kind reference_motion needs it
    reference: {columns: {orientation: [a, b, c, d]}, convention: body_to_world}
    reference: only a session of kind reference_motion has one
    kind: known_rotation, file: poses.csv, axis: x
    angle: missing; a session of kind known_rotation needs it
    format: netcdf4
    format: 'netcdf4' is not a format; did you mean 'netcdf'?
    file: poses.csv
    kind: missing
    kind: static, file: data/none.csv
    file: there is no file data/none.csv
    kind: static, file: data/simulated/iphone6/static.parquet
    file: there is no replica 'iphone6/static'; did you mean 'iphone_6/static'?
    kind: static, file: {url: 'https://a/b.csv', sha256: abc}
    file.sha256: 'abc' should match pattern '^[0-9a-f]{64}$'
    units: {acceleration: count}
    units.acceleration: 'count' needs the device's nominal.acceleration.scale (increments: × rate), or the name of the sensor and its range
    time_range: [5, 1]
    time_range: the start is not before the end
    time_range: [12:30:00, 50000]
    time_range.0: 12:30:00 is 45000 to YAML; write '12:30:00' with quotes, or 45000
    kind: known_rotation, file: poses.csv, sections: [{axis: x, start: 0, end: 1}]
    sections.0.angle: missing; give an angle or a rate
    columns: {temperature: 1.5}
    columns.temperature: 1.5 should be a valid integer
    columns: {acceleration: true}
    columns.acceleration: True is none of 'list', 'text', 'null'
    columns: {acceleration: [ax, ax, az]}
    columns.acceleration: ['ax', 'ax', 'az'] names a column twice
"""  # noqa: E501
DEVICE = """
    units: {time: sec}
    units.time: 'sec' is not a unit; did you mean 's'?
    lable: x
    lable: unknown key; did you mean 'label'?
    label:
    label: nothing is given
    type: 2nd
    type: '2nd' should match pattern '^[A-Za-z][A-Za-z0-9_-]{0,63}$'
    prior: family
    prior: there is no file family
    prior: 5
    prior: 5 should be a valid string
    prior: ''
    prior: '' should have at least 1 character
    prior: ../
    prior: ../ is not a regular file
    prior: results/imu/calibration.json
    prior: results/imu/calibration.json is a result of this workflow; name its source, or copy it out of results
    gravity: 98
    gravity: 98 should be less than or equal to 9.9
    full_scale: {acceleration: 1e3}
    full_scale.acceleration: 1e3 is text to YAML, no number; write 1000.0
    units: 5
    units: 5 should be a mapping of keys
    diagnose: {folds: 2.5}
    diagnose.folds: 2.5 should be a valid integer
    segment: {window_s: '1'}
    segment.window_s: '1' should be a valid number
    gravity: {latitude: 45, hight: 1, height: 2}
    gravity.hight: unknown key; did you mean 'height'?
    calibrate: {gyroscope_bias: rest}
    calibrate.gyroscope_bias: 'rest' is not a gyroscope_bias; did you mean 'rests'?
    sensor: icm42688q
    sensor: 'icm42688q' is not a sensor of the table; did you mean 'icm42688p'?
    sensor: gyrometer
    sensor: 'gyrometer' is not a sensor of the table; imuloop sensors lists them
    range: {acceleration: 16 g}
    range.acceleration: needs the device's sensor
    sensor: icm42688p, range: {acceleration: 16 deg/s}
    range.acceleration: accelerometer of ICM-42688-P: '16 deg/s' is not a range; use one of 2 g, 4 g, 8 g, 16 g
    sensor: fxos8700, range: {angular_rate: 250 deg/s}
    range.angular_rate: FXOS8700 has no gyroscope
    sensor: icm42688p, units: {acceleration: count}
    units.acceleration: 'count' needs the device's range.acceleration, one of 2 g, 4 g, 8 g, 16 g
    nominal: {acceleration: {offset: 32768}}
    nominal.acceleration.scale: missing; offset needs it
    nominal: {acceleration: {tolerance: {scale_factor: 3}}}
    nominal.acceleration.tolerance.scale_factor: 3 should be less than or equal to 0.5
    nominal: {acceleration: {tolerance: {bias: 0}}}
    nominal.acceleration.tolerance.bias: 0 should be greater than 0
    label: on
    label: on is true to YAML; write 'on' with quotes, or true
"""  # noqa: E501
MOVED = "kind: reference_motion, file: poses.csv, reference: {columns: {orientation: "
LONG = [
    (
        MOVED + "[0, 1, 2, 3]}, convention: body_to_wolrd}",
        "reference.convention: 'body_to_wolrd' is not a convention; did you mean 'body_to_world'?",
    ),
]
STATIC = "sessions: {a: {kind: static, file: poses.csv}}}"
RESERVED = "is reserved for other results; name it otherwise"
WHOLE = [
    ("devices: {}", "devices: {} should have at least 1 item after validation, not 0"),
    (
        f"devices: {{1imu: {{{STATIC}}}",
        "devices.1imu: '1imu' should match pattern '^[A-Za-z][A-Za-z0-9_-]{0,63}$'",
    ),
    (
        f"devices: {{imu: {{{STATIC.replace('a:', 'exports:')}}}",
        f"devices.imu.sessions.exports: 'exports' {RESERVED}",
    ),
    (f"devices: {{figures: {{{STATIC}}}", f"devices.figures: 'figures' {RESERVED}"),
    (f"devices: {{types: {{{STATIC}}}", f"devices.types: 'types' {RESERVED}"),
    (f"{session(SOUND)}\ndefaults: {{label: 3}}", "defaults.label: 3 should be a valid string"),
    (f"{session(SOUND)}\nmirror: nowhere", "mirror: there is no folder nowhere"),
    (
        f"devices:\n  imu: {{{STATIC}\n  imu: {{{STATIC}",
        "devices.imu: given twice (again in line 3); only one would count",
    ),
]


def one_fault():
    for table, of in ((SESSION, "devices.imu.sessions.a."), (DEVICE, "devices.imu.")):
        lines = [line.strip() for line in table.strip().splitlines()]
        for keys, fault in zip(lines[::2], lines[1::2], strict=True):
            beside = "" if keys.startswith(("kind:", "file:")) else f"{SOUND}, "
            text = session(SOUND, f"{keys} ,") if table is DEVICE else session(f"{beside}{keys}")
            yield pytest.param(text, of + fault, id=f"{of}{keys}")
    yield from ((session(keys), f"devices.imu.sessions.a.{fault}") for keys, fault in LONG)
    yield from WHOLE


def test_a_device_may_name_its_type_and_a_prior(faults):
    assert faults(session(SOUND, "type: chip, prior: poses.csv,")) == []


@pytest.mark.parametrize(("text", "line"), list(one_fault()))
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


def test_a_fault_hides_no_fault_that_takes_several_keys(faults):
    """A wrong unit and a missing file beside reserved names and a range."""
    text = f"""
    devices:
      figures: {{label: '', sessions: {{exports: {{kind: statc, file: poses.csv}}}}}}
      a:
        range: {{acceleration: 16 g}}
        sessions: {{x: {{{SOUND}, units: {{time: sec}}}}}}
      b: {{sessions: {{x: {{kind: static, file: none.csv, units: {{time: sec}}}}}}}}
    """
    assert {line.split(": ")[0] for line in faults(text)} == {
        "devices.figures",
        "devices.figures.label",
        "devices.figures.sessions.exports",
        "devices.figures.sessions.exports.kind",
        "devices.a.range.acceleration",
        "devices.a.sessions.x.units.time",
        "devices.b.sessions.x.file",
        "devices.b.sessions.x.units.time",
    }


@pytest.mark.parametrize(
    ("quantity", "written", "hint"),
    [
        ("angular_rate", "dps", "did you mean 'deg/s'?"),
        (
            "angular_rate",
            "mdps",
            "use one of rad/s, deg/s, mrad/s, deg/h, rpm, count, rad, mrad, deg",
        ),
        ("time", "µs", "did you mean 'us'?"),
        ("acceleration", "m/s²", "did you mean 'm/s^2'?"),
        ("temperature", "°C", "did you mean 'degC'?"),
    ],
)
def test_a_unit_is_never_mistaken_for_another_by_its_letters(faults, quantity, written, hint):
    [line] = faults(session(f"{SOUND}, units: {{{quantity}: '{written}'}}"))
    assert line.endswith(f"'{written}' is not a unit; {hint}")


def test_a_reference_in_the_log_needs_no_single_file(faults):
    files = "{acceleration: poses.csv, angular_rate: counts.csv}"
    text = f"{MOVED}[0, 1, 2, 3]}}, convention: body_to_world}}".replace("poses.csv", files)
    assert faults(session(text)) == []


def test_a_fault_of_the_defaults_is_named_once(faults):
    one = f"{{sessions: {{x: {{{SOUND}}}}}}}"
    assert len(faults(f"devices: {{a: {one}, b: {one}}}\ndefaults: {{gravity: 98}}")) == 1


def test_a_fault_names_the_file_that_holds_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "poses.csv").write_text("t,ax,ay,az,gx,gy,gz\n0,0,0,9.8,0,0,0\n")
    first = {"devices": {"a": {"sessions": {"x": {"kind": "static", "file": "poses.csv"}}}}}
    second = {"devices": {"a": {"label": 3}}}
    files = {name: tmp_path / name for name in ("first.yaml", "second.yaml")}
    for path, content in zip(files.values(), (first, second), strict=True):
        path.write_text(yaml.safe_dump(content))
    lines = config_faults(merge(first, second), files, REPLICAS)
    assert lines == ["second.yaml line 3: devices.a.label: 3 should be a valid string"]
