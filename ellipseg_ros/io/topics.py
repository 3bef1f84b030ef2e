"""Topics and services of the nodes: the one place for their names, types, QoS and users.

The nodes, bags, the recorder, the doctor, the import check and the security policy read these
tables. A new topic is a new row here and the code that fills its messages.
"""

from typing import NamedTuple

SEGMENTER, ASSOCIATOR, REPLAYER = "ellipseg_segmenter", "ellipseg_associator", "ellipseg_replayer"
NODES = (SEGMENTER, ASSOCIATOR, REPLAYER)


class Topic(NamedTuple):
    """One topic; all are reliable."""

    name: str  # in the namespace of the node; with a leading slash: absolute
    type: str
    publishers: tuple[str, ...]  # nodes of this package
    subscribers: tuple[str, ...] = ()  # likewise
    depth: int = 10  # messages kept for a slow subscriber
    latched: bool = False  # late subscribers get the last message (durability transient local)


class Service(NamedTuple):
    """One service; parameter services come in addition."""

    name: str
    type: str
    node: str


CLOUD = "sensor_msgs/msg/PointCloud2"
MARKERS = "visualization_msgs/msg/MarkerArray"
SEGMENT_ARRAY = "ellipseg_ros/msg/SegmentArray"
LANDMARK_ARRAY = "ellipseg_ros/msg/LandmarkArray"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
CURVE = "ellipseg_ros/msg/TuningCurve"
TRIGGER = "std_srvs/srv/Trigger"

# The segmenter's subscription has the depth and reliability of its parameters input_*.
POINTS = Topic("points", CLOUD, (REPLAYER,), (SEGMENTER,), depth=1000)
ODOMETRY = Topic("odometry", ODOMETRY_TYPE, (REPLAYER,), (SEGMENTER,), depth=1000)
TF = Topic("/tf", TF_MESSAGE, (), (SEGMENTER,), depth=1000)
TF_STATIC = Topic("/tf_static", TF_MESSAGE, (), (SEGMENTER,), depth=1000, latched=True)
SEGMENTED_POINTS = Topic("segmented_points", CLOUD, (SEGMENTER,))
ELLIPSOIDS = Topic("ellipsoids", MARKERS, (SEGMENTER,))
LANDMARKS = Topic("landmarks", LANDMARK_ARRAY, (SEGMENTER,), (ASSOCIATOR,))
SEGMENTS = Topic("segments", SEGMENT_ARRAY, (SEGMENTER,), (REPLAYER,))
TUNING_CURVE = Topic("tuning_curve", CURVE, (SEGMENTER,), depth=1, latched=True)
ASSOCIATIONS = Topic("associations", "ellipseg_ros/msg/Association", (ASSOCIATOR,))
ASSOCIATION_MARKERS = Topic("association_markers", MARKERS, (ASSOCIATOR,))
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", (SEGMENTER, ASSOCIATOR))
CLOCK = Topic("/clock", "rosgraph_msgs/msg/Clock", (REPLAYER,), (SEGMENTER, ASSOCIATOR))

# What the segmenter publishes of every update, also in bags; header first, apart from markers.
UPDATE_TOPICS = (SEGMENTED_POINTS, ELLIPSOIDS, LANDMARKS, SEGMENTS)
ASSOCIATOR_TOPICS = (ASSOCIATIONS, ASSOCIATION_MARKERS)
TOPICS = (POINTS, ODOMETRY, *UPDATE_TOPICS, TUNING_CURVE, *ASSOCIATOR_TOPICS, DIAGNOSTICS, CLOCK)
OPTIONAL_TOPICS = (TF, TF_STATIC)  # where tf2_msgs is installed

RESET = Service("~/reset", TRIGGER, SEGMENTER)
TUNE = Service("~/tune", TRIGGER, SEGMENTER)
SAVE = Service("~/save", TRIGGER, ASSOCIATOR)
LOAD = Service("~/load", TRIGGER, ASSOCIATOR)
CLEAR = Service("~/clear", TRIGGER, ASSOCIATOR)
PAUSE = Service("~/pause", "std_srvs/srv/SetBool", REPLAYER)
SERVICES = (RESET, TUNE, SAVE, LOAD, CLEAR, PAUSE)

# By name in a bag.
BAG_TOPICS = {
    f"/{topic.name.lstrip('/')}": topic
    for topic in (POINTS, ODOMETRY, TF, TF_STATIC, *UPDATE_TOPICS)
}
