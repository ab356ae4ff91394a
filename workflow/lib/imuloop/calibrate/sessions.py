"""The sessions of a device: which of them a fit uses, and what their files hold.

All functions take the sessions as a dict by name. Each session is a dict with its ``kind`` and the
paths of its files, ``samples`` and ``segments``.
"""

from dataclasses import replace

from imuloop.calibrate.poses import gather_poses
from imuloop.calibrate.recording import record
from imuloop.core.samples import (
    CHANNELS,
    OWN_TIME,
    TEMPERATURE,
    TIME,
    Samples,
    read_columns,
    read_metadata,
)
from imuloop.core.units import RawUnit

KINDS = ("multi_position", "six_position", "static", "known_rotation", "reference_motion")
# kinds of the sessions that are fitted together; the first one names the method of the calibration
GROUPS = {
    "multi_position": ("multi_position", "reference_motion"),
    "six_position": ("six_position",),
    "known_rotation": ("known_rotation",),
}


def usable_sessions(sessions, *kinds):
    """Return the sessions of some kinds that were not rejected.

    `sessions` are the sessions by name, and `kinds` are names of kinds, such as ``static``. A
    rejected session has no segments.

    Returns
    -------
    list of (dict, dict)
        Each session and the table of its segments, a dict of arrays.
    """
    chosen = [(s, read_columns(s["segments"])) for s in sessions.values() if s["kind"] in kinds]
    return [(session, table) for session, table in chosen if len(table["kind"])]


def why_no_pose(sessions, kind):
    """Return a text on why no session of a kind has a pose, with a reason for each such session.

    `sessions` are the sessions by name, and `kind` is the kind. A pose is an attitude in which the
    device rests.
    """
    fates = []
    for name, session in sessions.items():
        if session["kind"] == kind:
            rejected = not len(read_columns(session["segments"], ["kind"])["kind"])
            fates.append(f"{name} {'was rejected' if rejected else 'has no rest that is a pose'}")
    return f"no {kind} session with a pose" + (f": {', '.join(fates)}" if fates else "")


def read_poses(sessions, kind):
    """Return the Poses, means over rests, of the sessions of the kind `kind`.

    `sessions` are the sessions by name.
    """
    return gather_poses([table for _, table in usable_sessions(sessions, kind)])


def read_recording(sessions, longest_rotation, kind="multi_position"):
    """Return the Recording of the sessions of one method: poses, and the rotations between them.

    Parameters
    ----------
    sessions : dict of str to dict
        Sessions by name, each with ``kind`` and the paths ``samples`` and ``segments``.
    longest_rotation : float
        Longest rotation between two poses, s.
    kind : str, optional
        The method of calibration, a key of `GROUPS`, which has the kinds of the sessions to use.

    Returns
    -------
    Recording
        The poses and rotations; there are none if no session has a pose.
    """
    chosen = usable_sessions(sessions, *GROUPS[kind])
    columns = (TIME, *CHANNELS, TEMPERATURE, *OWN_TIME.values())
    samples = [read_columns(session["samples"], columns) for session, _ in chosen]
    # the values at which each channel clips
    rails = [read_metadata(session["samples"]).get("rails", {}) for session, _ in chosen]
    recording = record(samples, [segments for _, segments in chosen], longest_rotation, rails)
    return replace(recording, kind=kind, why_no_pose=why_no_pose(sessions, kind))


def largest_recording(sessions, longest_rotation):
    """Return the method in `GROUPS` whose sessions have the most poses, and their Recording.

    `sessions` are the sessions by name, and `longest_rotation` is the longest rotation between two
    poses, s.
    """
    recordings = [read_recording(sessions, longest_rotation, kind) for kind in GROUPS]
    recording = max(recordings, key=lambda recording: len(recording.poses))
    return recording.kind, recording


def first_log(sessions):
    """Return the metadata of the log from which the units of the device are taken, a dict.

    It is the log of the session whose kind is first in `KINDS`. `sessions` are the sessions by
    name. Exception: a session without samples is chosen only if no session has samples, because the
    units of a log that was not read are not known.
    """

    def order(session):
        """Return the sort key of a `session`: whether it lacks samples, then its kind's index."""
        return not len(Samples(session["samples"])), KINDS.index(session["kind"])

    return read_metadata(min(sessions.values(), key=order)["samples"])


def raw_units(sessions):
    """Return the RawUnits of the accelerometer and of the gyroscope, a tuple.

    They are the units of the log that `first_log` chooses from `sessions`, the sessions by name.
    """
    units = first_log(sessions)["raw_units"]
    chosen = (units[quantity] for quantity in ("acceleration", "angular_rate"))
    return tuple(
        RawUnit(name=unit["name"], scale=unit["scale"], offset=unit["offset"]) for unit in chosen
    )


def layout(sessions):
    """Return the declaration of the log that `first_log` chooses, a dict.

    The declaration has, for example, its columns and units. `sessions` are the sessions by name.
    The key ``sensor_ids`` has the numbers that an autopilot gives its sensors, if the log has them.
    """
    first = first_log(sessions)
    ids = first.get("sensor_ids")
    return first.get("declared", {}) | ({"sensor_ids": ids} if ids else {})


def hashes(sessions):
    """Return the SHA-256 of each file of the sessions' logs, a tuple of str without duplicates.

    `sessions` are the sessions by name. By the hashes a later calibration finds out whether its
    logs are the same.
    """
    files = [read_metadata(session["samples"]).get("sha256", {}) for session in sessions.values()]
    return tuple(dict.fromkeys(value for by_file in files for value in by_file.values()))
