"""The sections of the report, in the order of the thesis; ``chapter`` says how to add one."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from experiments.reproduce.chapter import CannotRun, Chapter, Section
from experiments.reproduce.context import Context


def _from(module: str) -> Callable[[Context], Chapter]:
    """Return the ``chapter`` of a module, which is loaded when it runs: a missing library stops no other section."""

    def run(context: Context) -> Chapter:
        try:
            made: Callable[[Context], Chapter] = import_module(f"experiments.reproduce.{module}").chapter
        except ModuleNotFoundError as error:
            if (error.name or "").split(".")[0] in ("experiments", "services"):
                raise
            raise CannotRun(f"the package {error.name} is not installed") from error
        return made(context)

    return run


SECTIONS = (
    Section("learners", "Learning agent (4.2, 4.5.1, Appendix A.1)", _from("learners")),
    Section("classifier", "Contact states (4.5.2, Appendix A.2)", _from("classifier")),
    Section("uncertainty", "Uncertainty of the cell (5.1, Appendix B.1)", _from("uncertainty")),
    Section("insertion", "Insertions (chapter 6, Appendix B.2)", _from("insertion")),
)
