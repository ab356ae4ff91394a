"""The tables of poses and of the moves between them: measurements and residuals."""

import numpy as np

from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.factors.velocity import midpoints

# errors of a residual: held out and in the fit, without the added effects and with them
ERRORS = ("before", "after", "in_sample_before", "in_sample_after")
# names of its components: of a pose on the sensor's axes, of a move square to gravity
COMPONENTS = {
    "gravity_norm": "",
    "pose_rate": "xyz",
    "rotation": "12",
    "velocity_vertical": "",
    "velocity_horizontal": "12",
}


def _of_residual(kind):
    """Return the names of the columns of one kind of residual."""
    parts = ("", *(f"_{part}" for part in COMPONENTS[kind]))
    return [*(f"{kind}_{error}{part}" for error in ERRORS for part in parts), f"{kind}_floor"]


# columns of poses.parquet and of moves.parquet, with their type
_PLACE = {"session": object, "pose": int, "start_s": float, "end_s": float}
_OF_POSE = (*CHANNELS, TEMPERATURE, *_of_residual("gravity_norm"), *_of_residual("pose_rate"))
_VELOCITY = (*_of_residual("velocity_vertical"), *_of_residual("velocity_horizontal"))
_OF_MOVE = (
    "angle_rad", "speed_rad_s", "axis_x", "axis_y", "axis_z", *_of_residual("rotation"),
    "knock_m_s", *_VELOCITY,
)  # fmt: skip
POSES = _PLACE | dict.fromkeys(_OF_POSE, float)
_OF_WINDOW = ("reference_rotation", "reference_force")
REFERENCE = _PLACE | {"residual": object}
REFERENCE |= {f"{kind}_{key}": float for kind in _OF_WINDOW for key in ("before", "after", "floor")}
MOVES = _PLACE | dict.fromkeys(_OF_MOVE, float)


def residual_columns(problem, kinds, errors, floor):
    """Return the columns of some kinds of residuals, a row per pose or move, SI.

    `errors`, (N,) each, are in the order of `ERRORS`; `floor`, (N,), is the variance that the noise
    alone gives to those held out.
    """
    found = {}
    for kind in kinds:
        rows, k = problem.of_kind(kind), problem.components(kind)
        columns = []
        for error in errors:
            parts = error[rows].reshape(-1, k).T
            # a lone component keeps its sign: the norm of gravity is too large or too small
            columns.extend(parts if k == 1 else (np.linalg.norm(parts, axis=0), *parts))
        columns.append(np.sqrt(floor[rows].reshape(-1, k).sum(axis=1)))
        found |= dict(zip(_of_residual(kind), columns, strict=True))
    return found


def poses_table(poses, names, residuals):
    """Return the columns of poses.parquet: the mean of each channel at each pose, and residuals.

    `names` are those of the sessions, `residuals` as in `residual_columns`; what is not there is
    not a number.
    """
    found = dict(zip(CHANNELS, (*poses.f.T, *poses.w.T), strict=True))
    if poses.temperature is not None:
        found[TEMPERATURE] = poses.temperature
    return _table(POSES, _place(poses, slice(None), names, poses) | found | residuals)


def moves_table(recording, names, gyroscope, force, residuals):
    """Return the columns of moves.parquet: how each move turned, calibrated, and its residual.

    The angle is the way turned, that is the integral of the size of the angular rate; the speed its
    greatest value; the axis the direction of the integral of the rate itself. The gyroscope's
    effects were fitted to this recording; `force`, (m, k, 3), is what they see of it.
    Others as in `poses_table`.
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
    found = {"angle_rad": angle, "speed_rad_s": size.max(axis=1)}
    found |= {f"axis_{name}": x for name, x in zip("xyz", axis, strict=True)}
    place = _place(recording.poses, rotations.first, names, rotations)
    return _table(MOVES, place | found | residuals)


def no_tables():
    """Return the tables by name where there is nothing to diagnose."""
    return {
        name: {column: np.zeros(0, kind) for column, kind in columns.items()}
        for name, columns in (("poses", POSES), ("moves", MOVES), ("reference", REFERENCE))
    }


def _place(poses, at, names, times):
    """Return session, number in it, start and end of poses, or of what begins at them."""
    number = np.arange(len(poses)) - np.searchsorted(poses.session, poses.session)
    return {
        "session": np.array(names, dtype=object)[poses.session[at]],
        "pose": number[at],
        "start_s": times.start_s,
        "end_s": times.end_s,
    }


def _table(columns, found):
    """Return the columns of a table; what was not found is not a number."""
    unknown = np.full(len(found["pose"]), np.nan)
    return {name: np.asarray(found.get(name, unknown), kind) for name, kind in columns.items()}
