"""The tables of poses and of the moves between them, with measurements and residuals."""

import numpy as np

from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.factors.rows import midpoints

# errors of a residual: without and with the added effects, held out and in the fit
ERRORS = ("before", "after", "in_sample_before", "in_sample_after")
# names of the components of each kind of residual: for a pose the axes of the sensor, for a move
# two directions perpendicular to gravity
COMPONENTS = {
    "gravity_norm": "",
    "pose_rate": "xyz",
    "rotation": "12",
    "velocity_vertical": "",
    "velocity_horizontal": "12",
}


def _names_of(kind):
    """Return the names of the columns of one `kind` of residual, a list of str.

    Each error in `ERRORS` has a column for each component of the residual. If there are several
    components, a column for their norm comes before them. The last name is the column of the
    floor, which is the error that the noise alone gives.
    """
    ends = ("", *(f"_{component}" for component in COMPONENTS[kind]))
    return [*(f"{kind}_{error}{end}" for error in ERRORS for end in ends), f"{kind}_floor"]


# columns of poses.parquet and of moves.parquet, with their type
_PLACE = {"session": object, "pose": int, "start_s": float, "end_s": float}
_OF_POSE = (*CHANNELS, TEMPERATURE, *_names_of("gravity_norm"), *_names_of("pose_rate"))
_VELOCITY = (*_names_of("velocity_vertical"), *_names_of("velocity_horizontal"))
_OF_MOVE = (
    "angle_rad", "speed_rad_s", "axis_x", "axis_y", "axis_z", *_names_of("rotation"),
    "knock_m_s", *_VELOCITY,
)  # fmt: skip
POSES = _PLACE | dict.fromkeys(_OF_POSE, float)
_OF_WINDOW = ("reference_rotation", "reference_force")
REFERENCE = _PLACE | {"residual": object}
REFERENCE |= {f"{kind}_{key}": float for kind in _OF_WINDOW for key in ("before", "after", "floor")}
MOVES = _PLACE | dict.fromkeys(_OF_MOVE, float)


def residual_columns(problem, kinds, errors, floor):
    """Return the columns of some kinds of residuals for the tables of poses or moves, a dict, SI.

    Each column has an entry per pose or move.

    Parameters
    ----------
    problem : PoseProblem
        Problem with N rows, one for each component of a residual.
    kinds : sequence of str
        Kinds of residuals.
    errors : sequence of ndarray, shape (N,)
        Four errors of each row: the held-out error without and with the added effects, then the
        residual of the fit without and with them.
    floor : ndarray, shape (N,)
        Variance of the held-out errors that the noise alone gives.
    """
    table = {}
    for kind in kinds:
        rows, k = problem.of_kind(kind), problem.kinds[kind][1]
        columns = []
        for error in errors:
            values = error[rows].reshape(-1, k).T
            # a single component keeps its sign; of several, the norm is the first column
            columns.extend(values if k == 1 else (np.linalg.norm(values, axis=0), *values))
        columns.append(np.sqrt(floor[rows].reshape(-1, k).sum(axis=1)))
        table |= dict(zip(_names_of(kind), columns, strict=True))
    return table


def poses_table(poses, names, residuals):
    """Return the columns of poses.parquet: the mean of each channel at each pose, and residuals.

    `poses` are the Poses, `names` are the names of the sessions, and `residuals` the columns of
    residuals, a dict of arrays. A column without data, such as the temperature of a device without
    a thermometer, is nan.
    """
    means = dict(zip(CHANNELS, (*poses.f.T, *poses.w.T), strict=True))
    if poses.temperature is not None:
        means[TEMPERATURE] = poses.temperature
    return _table(POSES, _place(poses, slice(None), names, poses) | means | residuals)


def moves_table(recording, names, gyroscope, force, residuals):
    """Return the columns of moves.parquet: the rotation of each of m moves, and residuals.

    ``angle_rad`` is the integral of the magnitude of the calibrated angular rate, ``speed_rad_s``
    the largest magnitude, and ``axis_x`` to ``axis_z`` the direction of the integral of the rate.

    Parameters
    ----------
    recording : Recording
        The poses and the m moves between them.
    names : list of str
        Names of the sessions.
    gyroscope : SensorCalibration
        The calibration that gives the angular rate.
    force : ndarray, shape (m, k, 3)
        Calibrated specific force at the k samples of each move. It is used if the gyroscope has
        effects, as these may depend on it.
    residuals : dict of str to ndarray, shape (m,)
        Columns of residuals.
    """
    rotations, channels = recording.rotations, None
    if gyroscope.effects:
        channels = recording.rotation_channels("gyroscope", gyroscope.output, force)
    rate = gyroscope.apply(rotations.w.reshape(-1, 3), channels).reshape(rotations.w.shape)
    size = np.linalg.norm(rate, axis=2)
    angle, *turn = (
        (rotations.steps * midpoints(x)).sum(axis=1) for x in (size, *np.moveaxis(rate, 2, 0))
    )
    axis = turn / np.maximum(np.linalg.norm(turn, axis=0), 1e-9)
    turns = {"angle_rad": angle, "speed_rad_s": size.max(axis=1)}
    turns |= {f"axis_{name}": x for name, x in zip("xyz", axis, strict=True)}
    place = _place(recording.poses, rotations.first, names, rotations)
    return _table(MOVES, place | turns | residuals)


def no_tables():
    """Return the tables without rows, a dict by name, for a device with nothing to diagnose."""
    return {
        name: {column: np.zeros(0, kind) for column, kind in columns.items()}
        for name, columns in (("poses", POSES), ("moves", MOVES), ("reference", REFERENCE))
    }


def _place(poses, indices, names, times):
    """Return the columns that identify each pose or move of a table, a dict of arrays.

    The columns are the session, the number of the pose in the session, and the start and end, s.

    Parameters
    ----------
    poses : Poses
        All poses, sorted by session.
    indices : slice or ndarray of int
        The poses of the table, or those at which its moves start.
    names : list of str
        Names of the sessions.
    times : Poses or Rotations
        Table with the start and end of these poses or moves, s.
    """
    # poses are sorted by session; the first pose of each session has the number 0
    number = np.arange(len(poses)) - np.searchsorted(poses.session, poses.session)
    return {
        "session": np.array(names, dtype=object)[poses.session[indices]],
        "pose": number[indices],
        "start_s": times.start_s,
        "end_s": times.end_s,
    }


def _table(types, columns):
    """Return the columns of a table with their types, a dict of arrays.

    `types` has the type of each column of the table by its name, and `columns` the arrays by name.
    Columns that are missing in `columns` are nan.
    """
    missing = np.full(len(columns["pose"]), np.nan)
    return {name: np.asarray(columns.get(name, missing), kind) for name, kind in types.items()}
