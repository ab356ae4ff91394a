"""Fits of the sensors of a simulated device at the poses, and the effects searched for there."""

from calibrate.devices import UNITS, known_noise
from imuloop.calibrate.calibrate import start_fit
from imuloop.diagnose.pose_problem import PoseProblem, interleaved_folds
from imuloop.diagnose.poses import diagnose_poses, pose_problem
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.model.effects import EffectKind, SensorEffect


def fitted_pair(truth, recording, noise=None, prior=None):
    """Return the JointFit of a recording or None, and the reason why a sensor is not fitted."""
    noise = noise or known_noise(truth)
    return start_fit(recording, noise, truth.gravity, UNITS, prior)


def pair_of(truth, recording, noise=None):
    """Return the JointFit of a recording that determines both sensors."""
    pair, reasons = fitted_pair(truth, recording, noise)
    assert reasons == {}
    return pair


def of_sensor(sensor, *effects):
    """Return effects of one sensor."""
    return tuple(SensorEffect(effect, sensor) for effect in effects)


def variants_of(sensor, *effects):
    """Return variants of one kind of effect of a sensor, by that kind."""
    return {EffectKind(type(effects[0]), sensor): of_sensor(sensor, *effects)}


def problem_of(pair, recording, variants=None, folds=10, **more):
    """Return a PoseProblem, folds interleaved, in which these variants are looked for."""
    fold_of_pose = interleaved_folds(len(recording.poses), folds)
    return PoseProblem(pair, recording, variants or {}, DiagnoseSettings(), 1, fold_of_pose, **more)


def pose_result(truth, recording, noise=None, tests=0, **settings):
    """Return the PoseResult of a recording."""
    pair, reasons = fitted_pair(truth, recording, noise)
    problem = pair and pose_problem(pair, recording, DiagnoseSettings(**settings), tests)
    return diagnose_poses(problem, reasons)
