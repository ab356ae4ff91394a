"""What the text of a config may be: files that are none, numbers and names that none can hold."""

import pytest

from entries import SOUND, session
from imuloop.config_text import unreadable

SHA = "0" * 64


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (None, ": there is no such file here; write one, or name one with --configfile"),
        ("", ": empty; it needs devices"),
        ("devices", ": not a mapping of keys; it needs devices"),
        ("devices: [", " line 1, column 11: no YAML: "),
        ("devices:\n\ta: 1\n", " line 2, column 1: no YAML: "),
        ("devices: 2024-02-30", ": cannot be read: day is out of range for month"),
        ("devices: " + 999 * "[", ": cannot be read: maximum recursion"),
        ("devices: {}", None),
    ],
)
def test_a_file_that_is_no_config_has_one_line(tmp_path, monkeypatch, content, line):
    monkeypatch.chdir(tmp_path)
    if content is not None:
        (tmp_path / "config.yaml").write_text(content)
    fault = unreadable("config.yaml")
    assert fault == line if line is None else fault.startswith(f"config.yaml{line}")
    assert "\n" not in (fault or "")


@pytest.mark.parametrize("number", ["1" * 400, "1.0e+400"])
def test_numbers_that_no_double_holds(faults, number):
    for text in (
        session(f"{SOUND}, columns: {{acceleration: [{number}, 1, 2]}}"),
        session(SOUND, f"nominal: {{acceleration: {{scale: {number}}}}},"),
        session(SOUND, f"label: {number},"),
    ):
        [line] = faults(text)
        assert line.endswith(" is no finite number of double precision") and len(line) < 200
        assert line.startswith("devices.imu.")
    # JSON, as which Snakemake reads what it can
    found = faults('{"devices": {"imu": {"sessions": {}}}, "mirror": 1e999}')
    assert "mirror: inf is no finite number of double precision" in found


@pytest.mark.parametrize("key", ["label", "file", "column"])
def test_text_that_is_no_unicode(faults, key):
    half = '"x\\ud800.csv"'
    label, file, column = (half if key == name else name for name in ("label", "file", "column"))
    text = f"kind: static, file: {file if key == 'file' else 'poses.csv'}"
    if key == "column":
        text += f", columns: {{time: {column}}}"
    found = faults(session(text, f"label: {label},"))
    assert len(found) == 1
    assert found[0].endswith("'x\\ud800.csv' holds half of a character, which is no Unicode")
    [line] = faults(session('kind: static, file: "a\\0.csv"'))
    assert line.endswith("file: 'a\\x00.csv' holds a zero byte")


@pytest.mark.parametrize("name", ["true", "~"])
def test_a_name_that_yaml_takes_for_none(faults, name):
    lines = faults(f"devices: {{{name}: {{sessions: {{a: {{{SOUND}}}}}}}}}")
    assert f"devices.{name}: '{name}' is no text to YAML; write it in quotes" in lines


def test_names_end_where_they_end(faults):
    """A plain $ in a pattern fits before a newline at the end."""
    [line] = faults(f'devices: {{"imu\\n": {{sessions: {{a: {{{SOUND}}}}}}}}}')
    assert "'imu\\n' is not a name (a letter, then" in line
    [line] = faults(session(f'kind: static, file: {{url: "https://h/a", sha256: "{SHA}\\n"}}'))
    assert line.endswith("\\n' is not a SHA-256 (64 digits 0-9 a-f)")
    [line] = faults(session(f"{SOUND}, time_range: ['now', null]"))
    assert "time_range: not ISO 8601: " in line


def test_what_cannot_be_shown_or_is_no_folder(faults):
    [line] = faults(session(SOUND, 'label: "a\\e[31m\\u202e",'))
    assert line == ("devices.imu.label: 'a\\x1b[31m\\u202e' holds what cannot be printed")
    assert faults(session(SOUND, 'label: "Müller’s “IMU” 5 × ☂",')) == []
    assert faults(f"cache: poses.csv\n{session(SOUND)}") == [
        "cache: poses.csv is a file, not a folder"
    ]
    assert faults(session(f"{SOUND}, format: ")) == [
        "devices.imu.sessions.a.format: nothing is given"
    ]
