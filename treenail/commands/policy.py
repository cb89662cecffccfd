"""``treenail policy``: print what the agent would do in a contact state, or when it feels a force."""

from __future__ import annotations

import argparse
import json
import re

from rich.table import Table

from services.bus.answers import ft_vector, state_number
from services.cell import client
from services.cell.terminal import console
from services.wire.actions import Increment
from services.wire.keys import POLICY
from services.wire.messages import Motion, PolicyAnswer


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    asked = parser.add_mutually_exclusive_group(required=True)
    asked.add_argument("--state", metavar="N", help="number of a contact state")
    asked.add_argument(
        "--ft",
        metavar="FX,FY,FZ,TX,TY,TZ",
        help="what the wrist feels [N, N m], such as -0.3,0.34,-0.74,-0.037,-0.033,0",
    )
    parser.add_argument("--json", action="store_true", help="as JSON")
    client.add_arguments(parser)
    # Else a vector that begins with a minus would count as an option: argparse knows single negative numbers only.
    parser._negative_number_matcher = re.compile(r"^-[\d.]")


def act(arguments: argparse.Namespace) -> None:
    """Print a row an action."""
    if arguments.state is not None:
        selector = f"{POLICY}?state={state_number(arguments.state)}"
    else:
        force_n, torque_nm = ft_vector(arguments.ft)
        selector = f"{POLICY}?ft={','.join(repr(component) for component in (*force_n, *torque_nm))}"
    with client.client_of(arguments) as cell:
        if arguments.json:
            print(json.dumps(cell.ask_one_json(selector)))
            return
        answer = cell.ask(selector, PolicyAnswer)
    shown = console()
    shown.print(title(answer), markup=False, highlight=False)
    shown.print(table(answer))


def table(answer: PolicyAnswer) -> Table:
    """Return a policy's answer for people; the best action is marked."""
    made = Table()
    if answer.increment is not None and answer.spread is not None:
        return _proposed(answer.increment, answer.spread)
    parts = ("at once", "+-", "after it") if answer.model else ()
    for heading in ("", "action", "value", *parts, "probability", "visits"):
        made.add_column(heading, justify="left" if heading == "action" else "right", no_wrap=True)
    rows = zip(answer.actions, answer.values, answer.probabilities, answer.visits, strict=True)
    for index, (action, value, probability, visits) in enumerate(rows):
        best = index == answer.best_action and answer.known
        why = _why(answer, index) if answer.model else ()
        cells = (action, f"{value:.3f}", *why, f"{probability:.4f}", str(visits))
        made.add_row("best" if best else "", *cells, style="bold" if best else None)
    return made


def _proposed(increment: Motion, spread: Motion) -> Table:
    """Return the move that is proposed, a row an axis, and how far from it others are tried."""
    made = Table()
    for heading in ("axis", "move", "+-"):
        made.add_column(heading, justify="left" if heading == "axis" else "right", no_wrap=True)
    for name, value, deviation in zip(Increment._fields, increment, spread, strict=True):
        made.add_row(name, f"{value:.4f}", f"{deviation:.4f}")
    return made


def _why(answer: PolicyAnswer, index: int) -> tuple[str, str, str]:
    """Return what an action's value is made of: what it earns at once, how surely, and what comes after it."""
    return f"{answer.model[index]:.3f}", f"{answer.deviations[index]:.3f}", f"{answer.table[index]:.3f}"


def title(answer: PolicyAnswer) -> str:
    """Return in words which state the answer is for, and how well the agent knows it."""
    state = "no contact state known so far" if answer.state is None else f"contact state {answer.state}"
    match = "" if answer.match is None else f", match {answer.match:.4f}"
    remark = "" if answer.known else ", never decided in"
    if answer.worth is not None:
        remark = f"; thought to be worth {answer.worth:.3f}" if answer.known else "; nothing learnt so far"
    if answer.partial:
        remark += "; only what comes after a move: ask with --ft what it is thought to earn at once, too"
    return f"{state}{match}{remark}\nrun {answer.run}, policy version {answer.policy_version}"
