"""The sections of the report, in the order of the thesis; ``chapter`` says how to add one."""

from __future__ import annotations

from functools import partial

from experiments.reproduce.chapter import CannotRun, Chapter, Section
from experiments.reproduce.context import Context


def _chapter(name: str, context: Context) -> Chapter:
    """Run a chapter's module, which is loaded only now: a missing library stops no other section."""
    try:
        match name:
            case "learners":
                from experiments.reproduce.learners import chapter
            case "classifier":
                from experiments.reproduce.classifier import chapter
            case "uncertainty":
                from experiments.reproduce.uncertainty import chapter
            case "plan":
                from experiments.reproduce.plan import chapter
            case "limits":
                from experiments.reproduce.limits import chapter
            case "claims":
                from experiments.reproduce.claims import chapter
            case _:
                from experiments.reproduce.insertion import chapter
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] in ("experiments", "services"):
            raise
        raise CannotRun(f"the package {error.name} is not installed") from error
    return chapter(context)


SECTIONS = (
    Section("learners", "Learning agent (4.2, 4.5.1, Appendix A.1)", partial(_chapter, "learners")),
    Section("classifier", "Contact states (4.5.2, Appendix A.2)", partial(_chapter, "classifier")),
    Section("uncertainty", "Uncertainty of the cell (5.1, Appendix B.1)", partial(_chapter, "uncertainty")),
    Section("plan", "The plan of 5.2.2: learners, policies, limits and centres", partial(_chapter, "plan")),
    Section("limits", "Collision limits, and what rules prevent (6.3, 6.4, 6.5)", partial(_chapter, "limits")),
    Section("claims", "Claims that were never tried (4.2.2, 5.3)", partial(_chapter, "claims")),
    Section("insertion", "Insertions (chapter 6, Appendix B.2)", partial(_chapter, "insertion")),
)
