"""Association messages and markers."""

from geometry_msgs.msg import Point, Quaternion, Transform, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ellipseg_ros.association.landmark_map import StoredMap
from ellipseg_ros.io.messages import quaternions
from ellipseg_ros.msg import Association as AssociationMessage
from ellipseg_ros.msg import LandmarkPair
from ellipseg_ros.records import SECOND, Array, Association, Landmarks

NAMESPACE = "association"
LINE_WIDTH_M = 0.05
CERTAIN, UNCERTAIN = (0.1, 0.8, 0.2), (0.9, 0.6, 0.1)  # colours: has the verdict a transform?


def association_message(
    association: Association, stored: StoredMap, landmarks: Landmarks, header: Header
) -> AssociationMessage:
    """Convert an association of map landmarks (`stored`) and current landmarks."""
    matrix = association.T_earlier_later
    x, y, z, w = quaternions(matrix[None, :3, :3])[0].tolist()
    return AssociationMessage(
        header=header,
        verdict=int(association.verdict),
        map_landmark_count=len(stored),
        landmark_count=len(landmarks),
        pairs=[_pair(association, row, stored, landmarks) for row in range(len(association))],
        transform=Transform(
            translation=Vector3(x=matrix[0, 3], y=matrix[1, 3], z=matrix[2, 3]),
            rotation=Quaternion(x=x, y=y, z=z, w=w),
        ),
        centre=_point(association.centre),
        covariance=association.covariance.ravel().tolist(),
        probability=association.transform_probability,
        undetermined=association.undetermined.T.ravel().tolist(),
        undetermined_names=association.undetermined_names,
        characteristic_length=association.characteristic_length,
    )


def _pair(
    association: Association, row: int, stored: StoredMap, landmarks: Landmarks
) -> LandmarkPair:
    i, j = association.pairs[row]
    pair = LandmarkPair(
        map_id=int(stored.landmarks.ids[i]),
        landmark_id=int(landmarks.ids[j]),
        kind=int(landmarks.kind[j]),
        probability=float(association.probability[row]),
        mahalanobis_distance=float(association.distance[row]),
    )
    last_seen = pair.map_last_seen
    last_seen.sec, last_seen.nanosec = divmod(int(stored.last_seen_ns[i]), SECOND)
    return pair


def association_markers(
    association: Association, stored: StoredMap, landmarks: Landmarks, header: Header
) -> MarkerArray:
    """A line from every current landmark to its map landmark; without pairs a deletion."""
    marker = Marker(header=header, ns=NAMESPACE, action=Marker.DELETE, type=Marker.LINE_LIST)
    if len(association):
        red, green, blue = CERTAIN if association.verdict.has_transform else UNCERTAIN
        marker.action = Marker.ADD
        marker.pose.orientation.w = 1.0
        marker.scale.x = LINE_WIDTH_M
        marker.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
        for i, j in association.pairs:
            ends = stored.landmarks.position[i], landmarks.position[j]
            marker.points += [_point(position) for position in ends]
    return MarkerArray(markers=[marker])


def _point(xyz: Array) -> Point:
    x, y, z = xyz.tolist()
    return Point(x=x, y=y, z=z)
