"""Faults of a session's files are named before the run."""

import dataclasses
import json
import os
import zipfile

import pyarrow as pa
import pyarrow.parquet as pq

from entries import SOUND, session
from imuloop.ingest import phone
from imuloop.ingest.formats import FORMATS


def test_a_log_can_be_a_folder(faults, tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.db3").write_text("damaged, for the job to find")
    assert faults(session("kind: static, file: bag")) == []
    line = "devices.imu.sessions.a.file: bag is a folder, not a file"
    (tmp_path / "bag" / "bag_0.db3").unlink()
    assert faults(session("kind: static, file: bag")) == [line]


def test_streams_of_a_large_log_are_checked_before_the_run(faults, tmp_path, monkeypatch):
    monkeypatch.setattr("imuloop.file_faults.CHECKED", 1 << 10)
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        for name in ("Accelerometer", "Gyroscope"):
            rows = "".join(f"{i / 100},0,0,1\n" for i in range(10_000))
            archive.writestr(f"{name}.csv", f"Time (s),{name} x,{name} y,{name} z\n{rows}")
    # in this process
    read, most = phone.read.__wrapped__, []

    def spy(*arguments, **options):
        most.append(options.get("most"))
        return read(*arguments, **options)

    sound = dataclasses.replace(FORMATS["phone"], read=spy)
    monkeypatch.setitem(FORMATS, "phone", sound)
    text = session("kind: static, file: log.zip, columns: {angular_rate: %s}")
    assert faults(text % "Gyroscope") == []
    assert most == [1 << 10]
    [line] = faults(text % "Gyrosope")
    assert "no stream 'Gyrosope'" in line and line.endswith("did you mean 'Gyroscope'?")
    # what the head lacks may come later; then once more for the other columns
    assert most[1:] == [1 << 10, None, 1 << 10]


def test_what_is_no_regular_file_or_may_not_be_read(faults, tmp_path, monkeypatch):
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    (tmp_path / "folder.csv").mkdir()
    os.mkfifo(tmp_path / "pipe.csv")
    for name, text in (
        ("loop.csv", "loop.csv is a link that leads to no file"),
        ("folder.csv", "folder.csv is a folder, not a file"),
        ("pipe.csv", "pipe.csv is not a regular file"),
        ("none.csv", "there is no file none.csv"),
    ):
        [line] = faults(session(f"kind: static, file: {name}"))
        assert line == f"devices.imu.sessions.a.file: {text}"
    assert faults(session(f"kind: static, file: {300 * 'x'}.csv")) == [
        "devices.imu.sessions.a.file: cannot be read: File name too long"
    ]
    [fault] = faults(f"mirror: {300 * 'x'}\n{session(SOUND)}")
    assert fault.startswith("mirror: there is no folder xxx")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert faults(session(SOUND)) == [
        "devices.imu.sessions.a.file: poses.csv cannot be read: permission denied"
    ]


def test_marks_of_one_pulse_per_second(faults, tmp_path):
    (tmp_path / "marks.csv").write_text("c,gnss\n1000000,5\n2000000,6\n")
    (tmp_path / "text.csv").write_text("no table\n")
    assert faults(session(f"{SOUND}, pps: {{file: marks.csv}}")) == []
    assert faults(session(f"{SOUND}, pps: {{file: marks.csv, counter: c, time: gnss}}")) == []
    assert faults(session(f"{SOUND}, pps: {{counter: gx, time: gy}}")) == []
    dated = "time_range: ['2024-02-29T23:59:00Z', null]"
    assert faults(session(f"{SOUND}, pps: {{file: marks.csv}}, {dated}")) == []
    key = "devices.imu.sessions.a.pps"
    for pps, line in (
        ("{counter: gx}", f"{key}.time: missing; marks are two columns of the log, or a file"),
        ("{file: none.csv}", f"{key}.file: there is no file none.csv"),
        ("{file: .}", f"{key}.file: . is a folder, not a file"),
        (
            "{file: text.csv}",
            f"{key}.file: the file is not a table of numbers in rows and columns; save it as CSV, "
            "a sample per line",
        ),
        ("{file: marks.csv, counter: q}", f"{key}.counter: no column 'q'; there are c, gnss"),
        (
            "{counter: gx, time: q}",
            f"{key}.time: no column 'q'; there are t, ax, ay, az, gx, gy, gz, note",
        ),
        ("{columns: [a, b]}", f"{key}.columns: unknown key; use one of file, counter, time"),
    ):
        assert faults(session(f"{SOUND}, pps: {pps}")) == [line]
    bare = "kind: static, file: bare.csv, columns: {acceleration: [0, 1, 2], "
    bare += "angular_rate: [3, 4, 5]}, rate: 9, pps: {file: marks.csv}"
    assert faults(session(bare)) == [
        f"{key}: the log has no time column, which is to be the local counter"
    ]


def test_paths_are_what_is_written(faults, tmp_path):
    """Snakemake puts wildcards in place of braces, in the paths of inputs too."""
    names = ["log_{x}.csv", " log.csv", "log.csv\n"]
    for name in names:
        (tmp_path / name).write_bytes((tmp_path / "poses.csv").read_bytes())
        [line] = faults(session(f"kind: static, file: {json.dumps(name)}"))
        assert line == "devices.imu.sessions.a.file: " + (
            f"{name}: in place of braces Snakemake puts the name of a device; rename it"
            if name == names[0]
            else f"{name!r} has a blank at an end or what cannot be printed; rename it"
        )
    [line] = faults(f"cache: 'c_{{x}}'\n{session(SOUND)}")
    assert line.startswith("cache: c_{x}: in place of braces")
    [line] = faults(session(f"{SOUND}, pps: {{file: '{names[0]}'}}"))
    assert line.startswith(f"devices.imu.sessions.a.pps.file: {names[0]}: in place of braces")


def test_names_in_a_folder_are_what_is_written(faults, tmp_path):
    """Each file of a folder is an input of Snakemake's."""
    (tmp_path / "imu0").mkdir()
    (tmp_path / "imu0" / "data.csv").write_bytes((tmp_path / "poses.csv").read_bytes())
    assert faults(session("kind: static, file: imu0")) == []
    for name in (b"a\xff.csv", b"b_{device}.csv"):
        path = os.path.join(os.fsencode(tmp_path / "imu0"), name)
        open(path, "w").close()
        [line] = faults(session("kind: static, file: imu0"))
        assert line.startswith("devices.imu.sessions.a.file: in imu0, ")
        assert {
            "a": "'a\\udcff.csv' has a blank at an end or what cannot be printed",
            "b": "braces",
        }[chr(name[0])] in line
        os.unlink(path)


def test_a_fault_that_nobody_foresaw_stops_no_other_device(faults, monkeypatch):
    def fails(paths, columns=None, batch_rows=0):
        raise ZeroDivisionError

    monkeypatch.setitem(FORMATS, "tsv", dataclasses.replace(FORMATS["tsv"], read=fails))
    broken, other = f"{SOUND}, format: tsv", "kind: static, file: none.csv"
    both = f"devices: {{a: {{sessions: {{x: {{{broken}}}}}}}, b: {{sessions: {{y: {{{other}}}}}}}}}"
    assert faults(both) == ["devices.b.sessions.y.file: there is no file none.csv"]


def test_stamps_that_are_too_large_are_for_the_job_to_reject(faults, tmp_path):
    for name, stamp in (("year", "9999-12-31T23:59:{:05.2f}"), ("digits", "1" * 400 + "{:09.2f}")):
        rows = [f"{stamp.format(i / 100)},0,0,9.8,0,0,0" for i in range(200)]
        (tmp_path / f"{name}.csv").write_text("\n".join(["t,ax,ay,az,gx,gy,gz", *rows]))
        assert faults(session(f"kind: static, file: {name}.csv")) == []


def test_a_name_that_repeats_is_named(faults, tmp_path):
    names = "t,ax,ay,az,gx,gy,gz,ax"
    table = pa.Table.from_arrays([pa.array([0.0, 0.01])] * 8, names=names.split(","))
    pq.write_table(table, tmp_path / "log.parquet")
    (tmp_path / "log.csv").write_text(f"{names}\n" + "0,0,0,9.8,0,0,0,5\n" * 3)
    for name in ("log.parquet", "log.csv"):
        assert faults(session(f"kind: static, file: {name}")) == [
            "devices.imu.sessions.a.file: ax/ay/az and ax/ay/az both look like acceleration; name "
            "one of them in columns.acceleration, by number from 0 to 7"
        ]
        text = f"kind: static, file: {name}, columns: {{acceleration: [7, 2, 3]}}"
        assert faults(session(text)) == []
