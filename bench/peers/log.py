"""A log at rest with noise of known size, made with numpy alone, and its file for ROS 2."""

import struct

import numpy as np

# Hz; samples of the filter's impulse response, and its corner as a share of the rate
RATE, TAPS, CORNER = 200.0, 256, 0.1
# N, B and K, SI, of accelerometer and gyroscope: 3 h show all three; each axis' own lie about them
TRUTH = np.repeat([(1e-3, 6e-4, 1.5e-4), (1e-4, 6e-5, 1.5e-5)], 3, axis=0)
SPREAD = 0.2

IMU = """std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
"""
PARTS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
}
# a record of MCAP with such a message in little-endian CDR; the frame is "imu"
MESSAGE = np.dtype(
    [
        *[("record", "u1"), ("size", "<u8"), ("channel", "<u2"), ("sequence", "<u4")],
        *[("logged", "<u8"), ("published", "<u8"), ("encoding", "<u4")],
        *[("s", "<i4"), ("ns", "<u4"), ("length", "<u4"), ("frame", "S4")],
        *[("orientation", "<f8", 4), ("covariance", "<f8", 9)],
        *[("rate", "<f8", 3), ("rate_covariance", "<f8", 9)],
        *[("acceleration", "<f8", 3), ("acceleration_covariance", "<f8", 9)],
    ]
)
MAGIC = b"\x89MCAP0\r\n"
# s since 1970
START = 1_700_000_000


def still_log(seed, n, behind_filter=False):
    """Return N, B and K of six axes, (6, 3), and `n` samples of each, (6, n), SI.

    White noise, flicker by its spectrum over four times the log or more, and a summed walk; where
    wanted, all of it behind a second-order Butterworth low-pass.
    """
    rng = np.random.default_rng(seed)
    truth = TRUTH * np.exp(rng.uniform(-SPREAD, SPREAD, TRUTH.shape))
    size = 1 << int(np.ceil(np.log2(4 * n)))
    f, axes = np.fft.rfftfreq(size, 1 / RATE), np.empty((6, n))
    f[0] = np.inf
    for i, (white, flicker, walk) in enumerate(truth):
        # two-sided density B^2 / (2 pi f), as in IEEE Std 952-1997
        spectrum = rng.standard_normal((len(f), 2)).view(complex)[:, 0]
        spectrum *= flicker * np.sqrt(size * RATE / (4 * np.pi * f))
        x = np.fft.irfft(spectrum, size)[: n + TAPS - 1]
        x += white * np.sqrt(RATE) * rng.standard_normal(len(x))
        x += np.cumsum(walk / np.sqrt(RATE) * rng.standard_normal(len(x)))
        axes[i] = np.convolve(x, low_pass(), "valid") if behind_filter else x[:n]
    axes[2] += 9.8
    return truth, axes


def low_pass():
    """Return the impulse response of the filter, by the bilinear transform."""
    c = 1 / np.tan(np.pi * CORNER)
    a = np.array([2 * (1 - c**2), 1 - np.sqrt(2) * c + c**2]) / (1 + np.sqrt(2) * c + c**2)
    response = np.zeros(TAPS)
    response[:3] = 1, 2, 1
    for k in range(1, TAPS):
        response[k] -= a[: min(k, 2)] @ response[max(k - 2, 0) : k][::-1]
    return response / response.sum()


def write_mcap(path, acceleration, angular_rate, t=None):
    """Write a log, (3, n) each, as messages sensor_msgs/msg/Imu in MCAP without chunks.

    `t`, (n,), are the times of the samples, s; by default they are even at `RATE`.
    """

    def text(value):
        return struct.pack("<I", len(value)) + value.encode()

    def record(code, *parts):
        return struct.pack("<BQ", code, sum(map(len, parts))) + b"".join(parts)

    definition = IMU + "".join(f"{'=' * 80}\nMSG: {name}\n{of}\n" for name, of in PARTS.items())
    kind = text("sensor_msgs/msg/Imu"), text("ros2msg"), text(definition)
    channel = struct.pack("<HH", 1, 1), text("/imu"), text("cdr"), struct.pack("<I", 0)
    n = acceleration.shape[1]
    messages = np.zeros(n, MESSAGE)
    since = np.arange(n) / RATE if t is None else t - t[0]
    logged = START * 10**9 + np.rint(since * 1e9).astype(int)
    fields = {"record": 5, "size": MESSAGE.itemsize - 9, "channel": 1, "sequence": np.arange(n)}
    fields |= {"logged": logged, "published": logged, "encoding": 0x100, "frame": b"imu"}
    fields |= {"s": logged // 10**9, "ns": logged % 10**9, "length": 4}
    fields |= {"acceleration": acceleration.T, "rate": angular_rate.T, "orientation": (0, 0, 0, 1)}
    for name, values in fields.items():
        messages[name] = values
    with open(path, "wb") as file:
        file.write(MAGIC + record(1, text("ros2"), text("")))
        file.write(record(3, struct.pack("<H", 1), *kind) + record(4, *channel))
        messages.tofile(file)
        file.write(record(15, bytes(4)) + record(2, bytes(20)) + MAGIC)
