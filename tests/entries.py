"""Configs of one session, as a user may write them."""

REPLICAS = {"iphone_6": ["static", "six_position"]}
SOUND = "kind: multi_position, file: poses.csv"


def session(text, device=""):
    """Return a config with one session; `text` is its keys, `device` further keys of the device."""
    return f"devices: {{imu: {{{device} sessions: {{a: {{{text}}}}}}}}}"
