"""Texts that are not a config, and numbers and names that a config cannot hold."""

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
        ("devices: [", ": cannot be read: while parsing a flow node"),
        ("devices:\n\ta: 1\n", ": cannot be read: while scanning for the next token"),
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


@pytest.mark.parametrize("name", ["true", "~"])
def test_a_name_that_yaml_takes_for_none(faults, name):
    lines = faults(f"devices: {{{name}: {{sessions: {{a: {{{SOUND}}}}}}}}}")
    assert f"devices.{name}: '{name}' is not text to YAML; write it in quotes" in lines


def test_names_end_where_they_end(faults):
    """A plain $ in a pattern fits before a newline at the end."""
    [line] = faults(f'devices: {{"imu\\n": {{sessions: {{a: {{{SOUND}}}}}}}}}')
    assert "'imu\\n' should match pattern" in line
    [line] = faults(session(f'kind: static, file: {{url: "https://h/a", sha256: "{SHA}\\n"}}'))
    assert line.endswith("\\n' should match pattern '^[0-9a-f]{64}$'")
    [line] = faults(session(f"{SOUND}, time_range: ['now', null]"))
    assert "time_range: Invalid isoformat string: 'now'" in line
