"""Detection of sensor frames by their names."""

import re
from collections.abc import Sequence

SENSOR = re.compile(
    r"lidar|laser|velodyne|ouster|(^|/)os_|sensor|livox|hesai|pandar|rslidar|robosense|scan"
    r"|camera|imu|base_(link|footprint|laser)",
    re.IGNORECASE,
)
WORLD = re.compile(r"odom|map|world|earth|init|local|global|utm|enu", re.IGNORECASE)


def looks_like_a_sensor(frame_id: str) -> bool:
    """Whether clouds in this frame are likely not registered."""
    return bool(SENSOR.search(frame_id)) and not WORLD.search(frame_id)


def warning(frame_id: str, odometry: Sequence[str] = ()) -> str:
    """The warning about clouds in a frame that is probably that of a sensor.

    odometry: topics on which one is published.
    """
    remedy = "remap odometry:= to that of an odometry, or set fixed_frame to a frame of tf"
    if odometry:
        remedy = " or ".join(f"remap odometry:={topic}" for topic in odometry)
    return (
        f"THE CLOUDS ARE IN FRAME {frame_id!r}, PROBABLY THAT OF A SENSOR, and are not placed by "
        f"poses: a moving sensor smears the window; {remedy}, or publish registered clouds"
    )
