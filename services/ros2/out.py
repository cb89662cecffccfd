"""Publishes what a cell feels and does as topics of ROS 2."""

from __future__ import annotations

from services.bus import command
from services.ros2.settings import Graph, graph_of
from services.rules.settings import add_settings


def main() -> None:
    """Parse the command line and serve."""
    from services.ros2 import names, out_service  # here: a missing extra is one line

    parser = command.parser("ros2_out", __doc__)
    parser.add_argument("--prefix", metavar="TOPIC", help="of all topics (default: /treenail/<cell>)")
    add_settings(parser, Graph)
    arguments = parser.parse_args()
    prefix = None if arguments.prefix is None else names.checked_topic(arguments.prefix, "--prefix")
    out_service.serve(command.options(arguments), out_service.Settings(graph_of(arguments), prefix))


if __name__ == "__main__":
    command.run("ros2_out", main)
