"""The robot link on the bus: motions made by a controller on a line; else as every arm (``services.bus.robot``)."""

from __future__ import annotations

from services.bus.robot import Manner, RobotShell
from services.bus.service import Options, Service
from services.robot_link.channel import Channel
from services.robot_link.link import Link
from services.robot_link.serial_line import Line
from services.robot_link.settings import Settings
from services.robot_link.val2.dialects import DIALECTS
from services.robot_link.val2.motion import Arm, Script
from services.robot_link.val2.terminal import Terminal


def serve(options: Options, settings: Settings, channel: Channel) -> None:
    """Run the robot link until it is stopped; ``channel`` is what lies between the terminal's text and the line."""
    with Service("robot_link", options) as service:
        service.claim()
        arm = Arm(settings.arm)
        terminal = Terminal(DIALECTS[settings.arm.dialect], echo=settings.arm.echo)
        link = Link(
            Line(settings.url, settings.line), channel, terminal, arm.get_ready, lambda error: shell.lost(error)
        )
        manner = Manner(settings.arm.settle_s, settings.oldest_s, settings.by_itself)
        shell: RobotShell[Script] = RobotShell(service, link, arm, manner)
        if shell.load():
            shell.serve()
