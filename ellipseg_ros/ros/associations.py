"""Association -> Association.msg and markers."""

from geometry_msgs.msg import Point, Quaternion, Transform, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ellipseg_ros.association.landmark_map import StoredMap
from ellipseg_ros.io.messages import quaternions
from ellipseg_ros.msg import Association, LandmarkPair
from ellipseg_ros.records import SECOND, Array, Landmarks
from ellipseg_ros.records import Association as Found

NAMESPACE = "association"
WIDTH = 0.05  # m, of a line
LIKELY, UNLIKELY = (0.1, 0.8, 0.2), (0.9, 0.6, 0.1)  # colours, by what the verdict says


def association_message(
    found: Found, known: StoredMap, live: Landmarks, header: Header
) -> Association:
    """What was found, with the ids of the map and of the topic."""
    matrix = found.T_earlier_later
    x, y, z, w = quaternions(matrix[None, :3, :3])[0].tolist()
    return Association(
        header=header,
        verdict=int(found.verdict),
        map_landmarks=len(known),
        landmarks=len(live),
        pairs=[_pair(found, row, known, live) for row in range(len(found))],
        transform=Transform(
            translation=Vector3(x=matrix[0, 3], y=matrix[1, 3], z=matrix[2, 3]),
            rotation=Quaternion(x=x, y=y, z=z, w=w),
        ),
        centre=_point(found.centre),
        covariance=found.covariance.ravel().tolist(),
        probability=found.transform_probability,
        unknown=found.undetermined.T.ravel().tolist(),
        unknown_names=found.undetermined_names,
        lever=found.characteristic_length,
    )


def _pair(found: Found, row: int, known: StoredMap, live: Landmarks) -> LandmarkPair:
    i, j = found.pairs[row]
    made = LandmarkPair(
        map_id=int(known.landmarks.ids[i]),
        landmark_id=int(live.ids[j]),
        kind=int(live.kind[j]),
        probability=float(found.probability[row]),
        distance=float(found.distance[row]),
    )
    made.map_seen.sec, made.map_seen.nanosec = divmod(int(known.last_seen_ns[i]), SECOND)
    return made


def association_markers(
    found: Found, known: StoredMap, live: Landmarks, header: Header
) -> MarkerArray:
    """A line from every landmark to its like in the map; none takes the old lines away."""
    marker = Marker(header=header, ns=NAMESPACE, action=Marker.DELETE, type=Marker.LINE_LIST)
    if len(found):
        red, green, blue = LIKELY if found.verdict.has_transform else UNLIKELY
        marker.action = Marker.ADD
        marker.pose.orientation.w = 1.0
        marker.scale.x = WIDTH
        marker.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
        for i, j in found.pairs:
            marker.points += [_point(known.landmarks.position[i]), _point(live.position[j])]
    return MarkerArray(markers=[marker])


def _point(xyz: Array) -> Point:
    x, y, z = xyz.tolist()
    return Point(x=x, y=y, z=z)
