"""Start the segmenter on a live topic.

ros2 launch ellipseg_ros segmenter.launch.py points:=/cloud_registered
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "ellipseg_ros"


def generate_launch_description() -> LaunchDescription:
    """The node and its arguments."""
    defaults = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "segmenter.yaml"])
    given = LaunchConfiguration
    segmenter = Node(
        package=PACKAGE,
        executable="segmenter",
        namespace=given("namespace"),
        remappings=[("points", given("points"))],
        parameters=[given("params"), {"use_sim_time": given("use_sim_time")}],
        output="screen",
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "points", default_value="points", description="topic of the registered clouds"
            ),
            DeclareLaunchArgument(
                "params", default_value=defaults, description="YAML file of parameters"
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="namespace of the node and its topics"
            ),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="false",
                description="use /clock for the stamps of diagnostics and logs",
            ),
            segmenter,
        ]
    )
