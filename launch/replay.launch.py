"""Replay a recording to the segmenter and show the result in RViz.

ros2 launch ellipseg_ros replay.launch.py source:=drive.mcap
ros2 launch ellipseg_ros replay.launch.py source:=sim:woodland rate:=2
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = "ellipseg_ros"
ARGUMENTS = {
    "source": ("sim:industrial", "a bag, a cloud file, or sim:SCENE"),
    "topic": ("", "topic of the clouds in the bag; empty: the only one"),
    "rate": ("1.0", "speed of the replay; 0: as fast as the segmenter is"),
    "loop": ("false", "start again at the end"),
    "ahead": (
        "3.0",
        "maximum sensor time [s] that clouds are ahead of the segments; 0: no flow control",
    ),
    "rviz": ("true", "start RViz"),
}


def generate_launch_description() -> LaunchDescription:
    """Replayer, segmenter, RViz, and the arguments."""
    config = PathJoinSubstitution([FindPackageShare(PACKAGE), "config"])
    given = LaunchConfiguration
    replayer = Node(
        package=PACKAGE,
        executable="replayer",
        parameters=[
            {
                # With a type, as YAML would parse an empty string as null.
                "source": ParameterValue(given("source"), value_type=str),
                "topic": ParameterValue(given("topic"), value_type=str),
                "rate": given("rate"),
                "loop": given("loop"),
                "ahead": given("ahead"),
            }
        ],
        output="screen",
    )
    segmenter = Node(
        package=PACKAGE,
        executable="segmenter",
        parameters=[
            PathJoinSubstitution([config, "segmenter.yaml"]),
            {"input_reliability": "reliable", "input_depth": 1000},
        ],
        output="screen",
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", PathJoinSubstitution([config, "ellipseg.rviz"])],
        condition=IfCondition(given("rviz")),
    )
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=about)
        for name, (default, about) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, replayer, segmenter, rviz])
