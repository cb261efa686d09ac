"""The layouts for other programs name topics and fields that exist."""

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_plant.message_types import fields

CONFIG = Path(__file__).parents[3] / "ros2_ws/src/flexslew_lab/config"
_PLACE = re.compile(r"^(/\w+)[./](\w+)(\[\d+\])?$")


def assert_exists(place: str) -> None:
    match = _PLACE.match(place)
    assert match, place
    topic, name, index = match.groups()
    found = {f.name: f for f in fields(TOPICS[topic].type)}
    assert found[name].array == bool(index)


def test_foxglove_plots_fields_of_our_topics() -> None:
    layout = json.loads((CONFIG / "foxglove.json").read_text())
    places = [p["value"] for c in layout["configById"].values() for p in c.get("paths", [])]
    assert len(places) > 8
    for place in places:
        assert_exists(place)
    for config in layout["configById"].values():
        for topic in [*config.get("topics", {}), *filter(None, [config.get("topicPath")])]:
            assert topic in TOPICS


def test_every_foxglove_panel_has_its_place() -> None:
    layout = json.loads((CONFIG / "foxglove.json").read_text())

    def panels(node: object) -> list[str]:
        if isinstance(node, str):
            return [node]
        assert isinstance(node, dict)
        return panels(node["first"]) + panels(node["second"])

    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])


def test_every_foxglove_panel_has_a_title_and_every_plot_its_unit() -> None:
    layout = json.loads((CONFIG / "foxglove.json").read_text())
    for name, config in layout["configById"].items():
        title = config["foxglovePanelTitle"]
        assert title == config["lichtblickPanelTitle"]  # its open fork reads another key
        if name.startswith("Plot!"):
            assert title.endswith(f"[{config['yAxisLabel']}]")


def test_plotjuggler_draws_fields_of_our_topics() -> None:
    root = ElementTree.parse(CONFIG / "plotjuggler.xml").getroot()
    curves = [c.attrib["name"] for c in root.iter("curve")]
    assert len(curves) > 8
    for curve in curves:
        assert_exists(curve)
    assert all(area.attrib["name"].endswith("]") for area in root.iter("DockArea"))  # a unit
    lists = [t.attrib["value"] for t in root.iter("selected_topics")]
    lists += [t.attrib["selected_topics"] for t in root.iter("parameters")]
    assert len(lists) == len(list(root.iter("plugin")))
    for topics in lists:
        chosen = topics.split(";")
        assert set(chosen) <= set(TOPICS)
        assert all(curve.startswith(tuple(f"{topic}/" for topic in chosen)) for curve in curves)


@pytest.mark.parametrize(
    ("name", "key", "type_name"),
    [
        ("Base and hub", "Description Topic", "std_msgs/msg/String"),
        ("Bent beams", "Topic", "visualization_msgs/msg/MarkerArray"),
    ],
)
def test_rviz_shows_our_topics_with_their_durability(name: str, key: str, type_name: str) -> None:
    config = yaml.safe_load((CONFIG / "bench.rviz").read_text())["Visualization Manager"]
    (display,) = [d for d in config["Displays"] if d["Name"] == name]
    topic = TOPICS[display[key]["Value"]]
    assert topic.type == type_name
    assert (display[key]["Durability Policy"] == "Transient Local") == topic.latched
    assert config["Global Options"]["Fixed Frame"] == "world"
