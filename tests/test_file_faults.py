"""Files of a session that are not there, or cannot be read, are named before the run."""

import json
import os

from entries import SOUND, session

FILE = "devices.imu.sessions.a.file: "


def test_a_log_can_be_a_folder_of_files_with_names_that_are_taken_as_written(faults, tmp_path):
    """Protects: each file of a folder is an input of Snakemake's, which fills braces."""
    (tmp_path / "imu0").mkdir()
    (tmp_path / "imu0" / "data.csv").write_bytes((tmp_path / "poses.csv").read_bytes())
    assert faults(session("kind: static, file: imu0")) == []
    for name, why in (
        (b"a\xff.csv", "'a\\udcff.csv' has a blank at an end or what cannot be printed"),
        (b"b_{device}.csv", "b_{device}.csv: in place of braces"),
    ):
        path = os.path.join(os.fsencode(tmp_path / "imu0"), name)
        open(path, "w").close()
        [line] = faults(session("kind: static, file: imu0"))
        assert line.startswith(f"{FILE}in imu0, {why}")
        os.unlink(path)


def test_what_is_no_regular_file_or_may_not_be_read(faults, tmp_path, monkeypatch):
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    os.mkfifo(tmp_path / "pipe.csv")
    for name, text in (
        ("loop.csv", "there is no file loop.csv"),
        ("pipe.csv", "pipe.csv is not a regular file"),
        ("none.csv", "there is no file none.csv"),
        ("results/imu/a/samples.parquet", "results/imu/a/samples.parquet is a result of this "
         "workflow; name its source, or copy it out of results"),
        (f"{300 * 'x'}.csv", "cannot be read: File name too long"),
    ):  # fmt: skip
        assert faults(session(f"kind: static, file: {name}")) == [FILE + text]
    pair = "kind: static, file: {acceleration: none.csv, angular_rate: poses.csv}"
    assert faults(session(pair)) == [f"{FILE[:-2]}.acceleration: there is no file none.csv"]
    pair = pair.replace("none.csv", "poses.csv")
    line = f"{FILE}poses.csv is given for both sensors; each has its own file"
    assert faults(session(pair)) == [line]
    [fault] = faults(f"mirror: {300 * 'x'}\n{session(SOUND)}")
    assert fault.startswith("mirror: there is no folder xxx")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert faults(session(SOUND)) == [f"{FILE}poses.csv cannot be read: permission denied"]


def test_files_beside_the_log(faults, tmp_path):
    (tmp_path / "marks.csv").write_text("c,gnss\n1000000,5\n2000000,6\n")
    assert faults(session(f"{SOUND}, pps: {{file: marks.csv}}")) == []
    assert faults(session(f"{SOUND}, pps: {{counter: gx, time: gy}}")) == []
    moved = "kind: reference_motion, file: poses.csv, reference: {file: none.csv, columns: "
    moved += "{orientation: [a, b, c, d]}, convention: body_to_world}"
    for keys, line in (
        (moved, "reference.file: there is no file none.csv"),
        *(
            (f"{SOUND}, pps: {pps}", line)
            for pps, line in (
                ("{counter: gx}", "pps.time: missing; marks are two columns of the log, or a file"),
                ("{file: none.csv}", "pps.file: there is no file none.csv"),
                ("{file: .}", "pps.file: . is not a regular file"),
                ("{file: 'a_{x}.csv'}", "pps.file: a_{x}.csv: in place of braces Snakemake puts "
                 "the name of a device; rename it"),
                ("{columns: [a, b]}", "pps.columns: unknown key; use one of file, counter, time"),
            )
        ),
    ):  # fmt: skip
        assert faults(session(keys)) == [f"devices.imu.sessions.a.{line}"]


def test_paths_are_what_is_written(faults, tmp_path):
    """Snakemake puts wildcards in place of braces, in the paths of inputs too."""
    names = ["log_{x}.csv", " log.csv", "log.csv\n"]
    for name in names:
        (tmp_path / name).write_bytes((tmp_path / "poses.csv").read_bytes())
        [line] = faults(session(f"kind: static, file: {json.dumps(name)}"))
        assert line == FILE + (
            f"{name}: in place of braces Snakemake puts the name of a device; rename it"
            if name == names[0]
            else f"{name!r} has a blank at an end or what cannot be printed; rename it"
        )
    [line] = faults(f"cache: 'c_{{x}}'\n{session(SOUND)}")
    assert line.startswith("cache: c_{x}: in place of braces")


def test_a_damaged_log_is_for_the_job_to_reject(faults, tmp_path):
    (tmp_path / "log.bag").write_text("damaged")
    assert faults(session("kind: static, file: log.bag, columns: {time: stamp}")) == []
