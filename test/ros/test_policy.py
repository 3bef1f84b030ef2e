"""The DDS security policy grants each node exactly the rights that it uses."""

import time
import xml.etree.ElementTree as ElementTree
from contextlib import ExitStack
from fnmatch import fnmatch
from pathlib import Path

import pytest
from node_kit import LIMIT, peer, running

from ellipseg_ros.io.topics import TF, TF_STATIC
from ellipseg_ros.ros.graph_probe import GraphProbe
from ellipseg_ros.ros.pose_input import tf_is_available

POLICY = Path(__file__).parents[2] / "config" / "sros2" / "ellipseg.policy.xml"
NODES = {
    "segmenter": ("segmenter_node", ["-p", "use_sim_time:=true", "-p", "pose_source:=odometry"]),
    "associator": ("associator_node", ["-p", "use_sim_time:=true"]),
    "replayer": (
        "replayer",
        ["-p", "source:=sim:industrial", "-p", "ahead:=1.0", "-p", "start_paused:=true"],
    ),
}


def allowed(enclave):
    """What the policy allows: "publish", "subscribe", "reply", "request" -> full names."""
    tree = ElementTree.parse(POLICY).getroot()
    (profile,) = tree.findall(f"./enclaves/enclave[@path='/ellipseg/{enclave}']/profiles/profile")
    found = {"publish": set(), "subscribe": set(), "reply": set(), "request": set()}
    own = f"/{profile.get('node')}/"
    for names in profile:
        for right, granted in names.attrib.items():
            assert granted == "ALLOW" and not found[right]
            texts = [item.text for item in names]
            assert len(set(texts)) == len(texts)
            full = [text.replace("~/", own) if text[0] in "~/" else f"/{text}" for text in texts]
            found[right] = set(full)
    return profile.get("node"), found


def done(node, name):
    """What a running node does, as the graph tells."""

    def names(which):
        return {topic for topic, _ in getattr(node, f"get_{which}_by_node")(name, "/")}

    return {
        "publish": names("publisher_names_and_types"),
        "subscribe": names("subscriber_names_and_types"),
        "reply": names("service_names_and_types"),
        "request": names("client_names_and_types"),
    }


@pytest.fixture(scope="module")
def graph(session_ros_domain, tmp_path_factory):
    """All nodes, with all that a setting can add."""
    folder = tmp_path_factory.mktemp("policy")
    with ExitStack() as stack:
        for name, (module, arguments) in NODES.items():
            stack.enter_context(running(module, arguments, folder / name))
        yield stack.enter_context(peer(session_ros_domain)).node


@pytest.mark.parametrize("enclave", NODES)
def test_node_uses_exactly_its_rights(graph, enclave):
    name, expected = allowed(enclave)
    # With an odometry only the static transforms are used, where tf2_msgs is installed.
    expected["subscribe"] -= {TF.name} if tf_is_available() else {TF.name, TF_STATIC.name}
    end = time.monotonic() + LIMIT
    found = None
    while found != expected and time.monotonic() < end:
        time.sleep(0.1)  # the graph tells of no change
        if name in graph.get_node_names():
            found = done(graph, name)
    assert found == expected


def test_operator_may_use_all_topics_and_services(session_ros_domain):
    _, operator = allowed("operator")
    topics, services = set(), set()
    for enclave in NODES:
        _, rights = allowed(enclave)
        topics |= rights["publish"] | rights["subscribe"]
        services |= rights["reply"]
    assert operator["subscribe"] == topics
    assert operator["request"] == services
    assert operator["publish"] == {"/parameter_events", "/rosout"}


def test_operator_rights_suffice_for_the_doctor(session_ros_domain):
    _, operator = allowed("operator")
    with GraphProbe("", "/") as observer:
        observer.probe(0.1)
        found = done(observer.node, observer.node.get_name())
    for right, names in found.items():
        for name in names:
            assert any(fnmatch(name, one) for one in operator[right]), f"{right} {name}"
