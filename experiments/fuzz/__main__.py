"""``make fuzz``: throw hostile inputs at everything that reads what comes over the bus or out of a file."""

from __future__ import annotations

import faulthandler
import sys
from collections.abc import Callable

from experiments.fuzz import guided
from experiments.fuzz.campaign import Report, all_targets, campaign, input_of
from experiments.fuzz.target import outcome
from experiments.lab.progress import Reporter, reporter
from services.rules import command_line
from services.rules.command_line import Parser, whole

HANGS_AFTER_S = 60
"""A reader that does not come back within this hangs; the process then ends with a traceback of where."""
MOST_GROWTH_BYTES = 32 * 1024 * 1024
"""How much memory may grow over the last nine tenths of a campaign of any length."""


def main() -> int:
    """Do what the command line says and return the exit status: 1 when something was found."""
    return command_line.run("make fuzz", _act)


def _act() -> int:
    parser = Parser(prog="make fuzz", description=__doc__)
    parser.add_argument("--inputs", type=whole(), default=1_000_000, help="inputs in all")
    parser.add_argument("--seed", type=whole(0), default=1, help="another seed makes other inputs")
    parser.add_argument("--only", metavar="READER", help="no other readers than this")
    parser.add_argument("--guided", type=whole(0), default=50_000, help="of these a reader, guided by coverage")
    parser.add_argument(
        "--number", type=whole(0), help="with --only: read this one input of the seed and show what comes"
    )
    arguments = parser.parse_args()
    targets = [target for target in all_targets() if arguments.only in (None, target.name)]
    if not targets or (arguments.number is not None and len(targets) != 1):
        parser.error(f"--only: expected one of {', '.join(target.name for target in all_targets())}")
    if arguments.number is not None:
        given = input_of(targets[0], arguments.seed, arguments.number)
        print(f"{given!r}\n{outcome(targets[0], given)}")
        return 0
    with reporter() as shown:
        report = campaign(targets, arguments.inputs, arguments.seed, _watched(arguments.inputs, shown))
    faulthandler.cancel_dump_traceback_later()
    print("\n".join(_summary(report)), flush=True)
    good = not report.findings and report.grown_bytes <= MOST_GROWTH_BYTES
    return 0 if _guided(arguments.guided, arguments.only) and good else 1


def _watched(inputs: int, shown: Reporter) -> Callable[[Report], None]:
    """Return a function that hears how far the campaign is, tells it, and watches that it goes on."""
    faulthandler.dump_traceback_later(HANGS_AFTER_S, exit=True)
    reach = shown.begin("readers", inputs, "inputs")

    def hear(report: Report) -> None:
        faulthandler.dump_traceback_later(HANGS_AFTER_S, exit=True)  # in place of the one before
        reach(report.inputs)

    return hear


def _guided(inputs: int, only: str | None) -> bool:
    """Run the part that coverage guides, if it can be, and print what came of it; False when something was found."""
    if inputs < 1:
        return True
    if not guided.available():
        print("guided by coverage: skipped, atheris is not installed here")
        return True
    good = True
    for one in guided.run_all(inputs, only):
        good = good and not one.failure
        before, after = one.branches
        print(f"guided by coverage: {one.target}: {one.inputs} inputs, branches {before} to {after}", flush=True)
        if one.failure:
            print(f"FOUND: {one.target}\n{one.failure}")
    return good


def _summary(report: Report) -> list[str]:
    """Return what came of it as lines: a row a reader, then the findings and the memory."""
    width = max(map(len, report.counts))
    lines = [f"{'reader':<{width}}  {'inputs':>8}  {'taken':>8}  refused"]
    for name, counts in report.counts.items():
        refused = ", ".join(f"{count} {word}" for word, count in sorted(counts.items()) if word != "taken")
        lines.append(f"{name:<{width}}  {sum(counts.values()):>8}  {counts['taken']:>8}  {refused}")
    for finding in report.findings:
        place = f"--only {finding.target!r} --seed {finding.seed} --number {finding.number}"
        lines += ["", f"FOUND: {place}", finding.given, finding.trace]
    before, grown = report.rss_before_bytes / 1e6, report.grown_bytes / 1e6
    lines.append(f"{report.inputs} inputs, {len(report.findings)} findings")
    lines.append(f"memory: {before:.1f} MB after a tenth, {grown:+.1f} MB from there on")
    return lines


if __name__ == "__main__":
    sys.exit(main())
