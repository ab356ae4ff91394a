"""The result of all stages for one device: an object that reads the files in its folder."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import tempfile
import textwrap
import weakref
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from pathlib import Path
from urllib.parse import quote

import imuloop
from imuloop import chain
from imuloop.core.errors import ImuloopError
from imuloop.core.files import make_folder, read_json, replaced
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.model.calibration import Calibration
from imuloop.model.prior_remarks import remarks

# columns of a result that is printed
WIDTH = 100
# name of the source of a log that was not a file
IN_MEMORY = "in memory"


@dataclass(frozen=True)
class Result:
    """The results of all stages for one device: its calibration, noise, diagnosis and report.

    They are read from the files in the device's folder when they are first used.
    """

    device: chain.Device  # input of the stages; its folder has the result files
    # a TemporaryFolder, which exists as long as the result; None if the user named the folder
    _folder: object = field(default=None, repr=False, compare=False)

    @cached_property
    def _qualities(self):
        """Content of the quality.json of each session, a dict by name."""
        return {n: read_json(files["quality"]) for n, files in self.device.sessions.items()}

    @property
    def logs(self) -> dict:
        """Source of each session's log, a dict by name of the session: a path, or ``in memory``."""
        return {name: log_source(quality) or name for name, quality in self._qualities.items()}

    @property
    def failures(self) -> tuple[str, ...]:
        """Lines of text on the logs that ingest rejected, each with the reasons."""
        rejected = {n: q["reasons"] for n, q in self._qualities.items() if q["reasons"]}
        return tuple(f"{self._log(n)}: rejected: {'; '.join(why)}" for n, why in rejected.items())

    @property
    def notes(self) -> tuple[str, ...]:
        """Lines of text on facts that ingest found in the logs and the user should look at."""
        by_session = self._qualities.items()
        return tuple(f"{self._log(n)}: {text}" for n, q in by_session for text in q["warnings"])

    def _log(self, session):
        """Return the name by which a message calls the log of a session.

        It is the path of the log. For a log in memory, it is `session`, the name of the session.
        """
        source = self.logs[session]
        return session if source == IN_MEMORY else source

    @cached_property
    def calibration(self) -> Calibration:
        """The final calibration with its effects, the model that the diagnosis ended with."""
        return Calibration.from_json(self.device.file("calibration.json"))

    @cached_property
    def noise(self) -> dict:
        """Noise of each channel, a dict of `AxisNoise` by channel, ``ax`` to ``gz``, SI."""
        return NoiseModel.from_json(self.device.file("noise.json")).axes

    @cached_property
    def diagnosis(self) -> dict:
        """Content of diagnosis.json, a dict: verdicts, effects and errors of each sensor."""
        return read_json(self.device.file("diagnosis.json"))

    @property
    def verdict(self) -> dict:
        """Verdict by sensor and kind of data, such as ``verdict["gyroscope"]["poses"]``.

        A verdict is a word on the remaining error, such as ``consistent`` or ``unexplained``.
        """
        return {
            sensor: {record: block["verdict"] for record, block in records.items()}
            for sensor, records in self.diagnosis["sensors"].items()
        }

    @property
    def plot(self):
        """The report's figures, an `imuloop.plot.Plots`: ``plot.allan()`` returns some of them."""
        from imuloop.plot import Plots

        self._write_curves()
        return Plots(self.device)

    def _write_curves(self):
        """Write the Allan curves of all sessions unless they exist; only pictures need them."""
        if not all(files["allan"].exists() for files in self.device.sessions.values()):
            chain.allan(self.device)

    def report(self, path, command="imuloop.calibrate", folder=None) -> Path:
        """Write the report, one HTML file, to `path`; return this path.

        `command` is the command that the report names as its origin. The report has relative links
        to the result files. They lead to `folder`, if the result will be saved there, or by default
        to the files where they are. Without `folder`, files in a temporary folder get no links.
        """
        from imuloop.report.provenance import provenance
        from imuloop.report.report import write_report

        path, lasting = Path(path), None if self._folder else self.device.folder
        self._write_curves()
        chain.report_device(self.device)
        sessions = {n: {"kind": k, "log": self.logs[n]} for n, k in self.device.kinds.items()}
        config = {
            "gravity": self.device.gravity,
            "prior": self.device.prior.get("file"),
            "sessions": sessions,
            "data_sheet": self.device.data_sheet,
        }
        repository = Path(imuloop.__file__).parents[3]
        made_by = provenance(imuloop.__version__, repository, command, config)
        write_report([self.device.folder], made_by, path, self.device.file("comparison.csv"))
        _link(path, self.device.name, Path(folder) if folder else lasting)
        return path

    def export(self, folder) -> list:
        """Write files with the calibration for other tools into `folder`; return their paths."""
        make_folder(folder)
        chain.export(self.device)
        sources = sorted(self.device.file("exports").iterdir())
        targets = [Path(folder) / source.name for source in sources]
        for source, target in zip(sources, targets, strict=True):
            # source and target may be the same file, which a copy would refuse
            target.write_bytes(source.read_bytes())
        return targets

    def save(self, folder) -> Path:
        """Copy the result's files into `folder`, for `imuloop.load`; return the path of `folder`.

        Exports and Allan curves are made before and copied, too, so that `folder` has the same
        files as the results of the workflow.
        """
        make_folder(folder)
        self._write_curves()
        chain.export(self.device)
        if Path(folder).resolve() != self.device.folder.resolve():
            shutil.copytree(self.device.folder, folder, dirs_exist_ok=True)
        return Path(folder)

    def __reduce__(self):
        # a pickle holds the files, because the folder may be temporary or of another machine
        folder = self.device.folder
        files = {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
        return _unpickle, (self.device, files)

    def __str__(self):
        """Return the rejected logs, the notes, the calibration and the verdicts as text."""
        title = f"{self.device.label or self.device.name}, gravity {self.device.gravity:.6g} m/s²"
        named = self.device.data_sheet.get("sensor")
        title += f", sensor {named}:" if named else ":"
        lines = [title, *self.failures, *self.notes]
        for name in SENSORS:
            sensor = getattr(self.calibration, name)
            lines.append(f"  {name}, calibration: {_basis(sensor)}")
            lines += [f"  {name}: {remark}" for remark in remarks(name, sensor)]
        return "\n".join([*_wrap(lines), *verdict_lines(self.diagnosis)])

    def __repr__(self):
        verdicts = [
            f"{sensor} {record} {verdict}"
            for sensor, records in self.verdict.items()
            for record, verdict in records.items()
        ]
        return f"<Result of {self.device.name}: {', '.join(verdicts)}>"

    def _repr_html_(self):
        """Return the result as HTML, for a notebook."""
        return f"<pre>{escape(str(self))}</pre>\n{self.calibration._repr_html_()}"


def verdict_lines(diagnosis):
    """Return the verdicts of a diagnosis as lines of text, a list.

    Sensors and kinds of data with the same verdict share a line. `diagnosis` is the content of
    diagnosis.json.
    """
    from imuloop.report.findings import blocks
    from imuloop.report.page import phrase

    places = {}
    for block in blocks(diagnosis):
        place = f"{block['sensor']}, {block['part'].replace('_', ' ')}"
        places.setdefault(phrase("verdict", b=block), []).append(place)
    return _wrap(f"  {'; '.join(where)}: {text}" for text, where in places.items())


def _wrap(lines):
    """Return `lines` of text as a list in which no line is longer than `WIDTH`."""
    wrapped = (textwrap.wrap(line, WIDTH, subsequent_indent="    ") for line in lines)
    return [part for parts in wrapped for part in parts]


class TemporaryFolder:
    """A folder that is removed when no object refers to it any more; `name` is its path."""

    def __init__(self):
        self.name = tempfile.mkdtemp(prefix="imuloop-")
        weakref.finalize(self, shutil.rmtree, self.name, ignore_errors=True)


def _unpickle(device, files):
    """Return the Result of a pickle, with its files in a temporary folder.

    The folder is removed when the Result does not exist any more. `device` is its Device, whose
    folder may not exist on this machine. `files` has the content of each file by its path in that
    folder.
    """
    folder = TemporaryFolder()
    for name, content in files.items():
        path = Path(folder.name, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return Result(replace(device, folder=Path(folder.name)), folder)


def load(folder) -> Result:
    """Return the result whose files lie in a folder.

    Parameters
    ----------
    folder : path-like
        ``results/<device>`` of the workflow, ``folder`` of `calibrate`, or the folder of
        `Result.save`. The result has the label of the device only if a report was written.

    Raises
    ------
    ImuloopError
        If the files of a result are not there.
    """
    folder = Path(folder)
    missing = [n for n in ("calibration.json", "diagnosis.json") if not (folder / n).is_file()]
    if missing:
        raise ImuloopError(f"{folder}: no folder of a result: it has no {missing[0]}")
    calibration = Calibration.from_json(folder / "calibration.json")
    kinds = {p.parent.name: read_json(p)["kind"] for p in sorted(folder.glob("*/quality.json"))}
    summary = folder / "summary.json"
    device = chain.Device(
        name=calibration.device,
        folder=folder,
        kinds=kinds,
        label=read_json(summary)["label"] if summary.is_file() else "",
        gravity=calibration.gravity,
    )
    return Result(device)


def log_source(quality):
    """Return the source of a log as text: its path, ``in memory``, or an empty text if not known.

    `quality` is the content of its quality.json. The paths of a log in two files are joined by
    "and".
    """
    # a source begins with its path or address
    places = (str(next(iter(source.values()))) for source in quality["source"].values())
    return " and ".join(dict.fromkeys(places))


def _link(page, name, folder):
    """Rewrite the report of a device so that its links to result files lead to `folder`.

    `page` is the path of the HTML file, and `name` the name of the device. If `folder` is None, the
    page has no links to result files and no words about them.
    """
    text = page.read_text("utf-8")
    links = rf'<a href="(?:{re.escape(name)}/)?((?:figures|exports)/[^"]*|[\w.]+\.(?:json|csv))">'
    if folder is None:
        text = re.sub("<!-- files -->.*?<!-- /files -->", "", text, flags=re.DOTALL)
        text = re.sub(r"[,:] see diagnosis\.json", "", text)
        text = re.sub(rf" ?{links}(?:CSV|SVG)</a>", "", text)
        text = re.sub(rf"{links}(.*?)</a>", r"\2", text)
    else:
        relative = quote(os.path.relpath(folder, page.parent))
        text = re.sub(links, rf'<a href="{relative}/\1">', text)
        calibration = escape(shlex.quote(str(folder / "calibration.json")))
        text = text.replace(f"results/{name}/calibration.json", calibration)
    with replaced(page) as temporary:
        temporary.write_text(text, "utf-8")


def _basis(sensor):
    """Return a text on the calibration of a sensor: its method, scale factors and biases.

    The values have their standard errors. `sensor` is the SensorCalibration.
    """
    from imuloop.report.numbers import typeset, with_sigma
    from imuloop.report.page import WORDS

    text, std, raw = WORDS["methods"][sensor.method], sensor.std, typeset(sensor.raw_unit.name)
    per = "" if sensor.raw_unit.name in ("m/s^2", "rad/s") else f" SI per {raw}"
    for word, symbol, unit in (("scale factor", "K", per), ("bias", "b", f" {raw}")):
        names = [f"{symbol}{axis}" for axis in range(3)]
        if set(names) <= set(std):
            values = zip(getattr(sensor, symbol), names, strict=True)
            numbers = ", ".join(with_sigma(value, std[name]) for value, name in values)
            text += f"; {word} {symbol} {numbers}{unit}"
    if sensor.unimproved:
        text += f"; {sensor.prior['source']}: {', '.join(sensor.unimproved)}"
    return text
