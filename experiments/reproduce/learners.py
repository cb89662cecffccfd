"""Chapter 4 on learners: how actions are chosen, Q-learning and SARSA in the maze and at the cliff (4.2, 4.5.1, A.1).

Everything learns through the agent service's own learner.
"""

from __future__ import annotations

import numpy as np

from experiments.reproduce import learner_figures as figures
from experiments.reproduce.chapter import Block, Chapter, Comparison, Comparisons, Figure, Heading, Text
from experiments.reproduce.context import Context
from experiments.reproduce.learner_cliff import cliff
from experiments.reproduce.learner_gym import gym
from experiments.reproduce.learner_maze import maze
from experiments.reproduce.verdicts import Verdict
from services.agent.policies import probabilities
from services.wire.definition import Softmax

_TOLERANCE = 1e-12


def chapter(context: Context) -> Chapter:
    """Return the chapter."""
    return Chapter((*_choosing(), *maze(context), *cliff(context), *gym(context)))


def _choosing() -> tuple[Block, ...]:
    """Equations 4.1 to 4.3 as the agent's policies compute them."""
    return (
        Heading("How actions are chosen"),
        Text(
            "Both figures are computed by the policies that the agent uses. The thesis names neither the fifth μ of "
            "its Fig. 4.3 nor the values of Fig. 4.4; μ = 10 and five values from -4 to 0 stand in for them."
        ),
        Figure("4.3", "ε over the episodes by equation 4.2. The smaller μ, the longer.", figures.epsilon_schedule()),
        Figure(
            "4.4", "Gibbs distribution (equation 4.3). The larger β, the more the best is preferred.", figures.gibbs()
        ),
        Comparisons((_epsilon_holds(), _gibbs_holds()), "Choosing actions"),
    )


def _epsilon_holds() -> Comparison:
    wrong = max(
        abs(figures.epsilon(mu, episode) - 1.0 / (mu * episode + 1.0))
        for mu in figures.MUS
        for episode in (0, 1, 10, 100, 500)
    )
    return Comparison(
        "ε of the policy against equations 4.1 and 4.2",
        "ε = 1/(μn + 1)",
        f"the same to {wrong:.0e}" if wrong else "the same to the last bit",
        Verdict.MATCHES if wrong < _TOLERANCE else Verdict.DIFFERS,
        "The policy does not follow the equation: this is an error in Treenail.",
    )


def _gibbs_holds() -> Comparison:
    curves = {
        beta: probabilities(figures.VALUES, Softmax(beta=beta, beta_per_episode=0.0), 0) for beta in figures.BETAS
    }
    uniform = bool(np.allclose(curves[0.0], 1.0 / figures.VALUES.size, atol=_TOLERANCE))
    sums = all(abs(float(curve.sum()) - 1.0) < _TOLERANCE for curve in curves.values())
    rising = all(bool((np.diff(curve) > 0).all()) for beta, curve in curves.items() if beta > 0)
    holds = uniform and sums and rising
    return Comparison(
        "Gibbs distribution: uniform at β = 0, adds up to 1, better actions likelier",
        "yes (Fig. 4.4)",
        "yes" if holds else "no",
        Verdict.MATCHES if holds else Verdict.DIFFERS,
        "The policy does not follow the equation: this is an error in Treenail.",
    )
