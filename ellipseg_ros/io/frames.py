"""Whether a frame moves with the vehicle, going by its name."""

import re

SENSOR = re.compile(
    r"lidar|laser|velodyne|ouster|(^|/)os_|sensor|livox|hesai|pandar|rslidar|robosense|scan"
    r"|camera|imu|base_(link|footprint|laser)",
    re.IGNORECASE,
)
WORLD = re.compile(r"odom|map|world|earth|init|local|global|utm|enu", re.IGNORECASE)


def looks_like_a_sensor(frame_id: str) -> bool:
    """Whether clouds in this frame are likely not registered."""
    return bool(SENSOR.search(frame_id)) and not WORLD.search(frame_id)


def warning(frame_id: str) -> str:
    """What to say of clouds in a frame that looks like a sensor's."""
    return (
        f"THE CLOUDS ARE IN FRAME {frame_id!r}, WHICH LOOKS LIKE A SENSOR'S: registered clouds "
        "are expected, in a fixed frame such as odom; else a window of a moving sensor is smeared"
    )
