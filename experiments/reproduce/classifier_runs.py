"""The runs behind the chapter on the classifier: vectors recorded, and shown to a fresh ART2 network one by one."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain

import msgspec
import numpy as np
from msgspec.structs import replace

from experiments.lab.agreement import adjusted_rand_index, purity
from experiments.lab.contact_states import Sample
from experiments.lab.recordings import Supervised, cell, record
from experiments.reproduce.context import Context
from services.classifier.art2 import Art2
from services.wire.definition import Art2Settings
from services.wire.definition_file import definition_sha256

PART_VECTORS = 5056
"""Vectors of a part; four make as many as the thesis has."""
PARTS, RECORDINGS = 4, 4
QUICK_PARTS, QUICK_PART_VECTORS, QUICK_RECORDINGS = 2, 1264, 1
"""An eighth of the thesis's vectors, over two processes."""
PROBES = 5
LOOK_EVERY = 1000
"""Presentations between looks at the probes, after one at the first."""
UNCLASSIFIED = -1
"""Answer to a probe that fits no class yet."""
SETTINGS = Art2Settings(capacity=5000, when_full="refuse")
"""Treenail's own settings, with room for however many classes there will be."""
_ORDER, _PROBES = 1, 2
"""Keep the dice for orders and for probes apart."""

Groups = list[list[Sample]]
"""Vectors by insertion or execution: what came in one go."""


@dataclass(frozen=True)
class Part:
    """What a part of a recording depends on."""

    seed: int
    vectors: int
    noisy: bool = True
    """Whether the sensor has noise; the arm has it anyhow."""
    cell_sha256: str = field(default_factory=lambda: definition_sha256(cell()))
    version: int = 1


def record_part(part: Part) -> list[Supervised]:
    """Record a part."""
    definition = cell()
    if not part.noisy:
        definition = replace(definition, noise=replace(definition.noise, force_n=0.0, torque_nm=0.0))
    return record(definition, part.seed, part.vectors)


@dataclass(frozen=True)
class Source:
    """Vectors to be shown, with what is true of each."""

    groups: Groups
    sha256: str

    @classmethod
    def of(cls, groups: Groups) -> Source:
        """Take vectors; their checksum names them."""
        return cls(groups, hashlib.sha256(msgspec.json.encode(groups)).hexdigest())


def recordings(context: Context) -> list[list[Supervised]]:
    """Return the recordings: in full mode several of as many vectors as the thesis's, in quick mode a short one."""
    parts, vectors, count = PARTS, PART_VECTORS, RECORDINGS
    if context.quick:
        parts, vectors, count = QUICK_PARTS, QUICK_PART_VECTORS, QUICK_RECORDINGS
    keys = [Part(number, vectors) for number in range(parts * min(count, len(context.seeds)))]
    done = context.pieces("insertions, recorded", keys, record_part, list[Supervised])
    return [list(chain(*done[first : first + parts])) for first in range(0, len(done), parts)]


@dataclass(frozen=True)
class Shown:
    """What a run of the network depends on."""

    source_sha256: str
    order: int
    """0 for the order recorded; with any other number what came in one go stays together, in another order."""
    presentations: int
    """Shown more often than there are vectors, they come again, each time in another order."""
    settings: Art2Settings
    version: int = 1


@dataclass(frozen=True)
class Learnt:
    """What the network made of it."""

    sizes: list[int]
    """How many vectors were answered with each class, by order of birth; as many as there are classes."""
    looks: list[list[int]]
    """Class of each probe at ``looked_at``, or UNCLASSIFIED."""
    ari: float
    """Adjusted Rand index of the answers given and what is true."""
    purity: float
    ari_side: float
    """Adjusted Rand index with the octants that touch alone; of labels that name none it means nothing."""
    ari_feature: float
    """The same with the features alone."""

    @property
    def classes(self) -> int:
        """Number of classes at the end."""
        return len(self.sizes)


def learn(sources: Mapping[str, Groups], shown: Shown) -> Learnt:
    """Show vectors to a fresh network, each learnt at once; ``sources`` has them by checksum."""
    groups = sources[shown.source_sha256]
    order = in_order(groups, shown.order, shown.presentations)
    everything = [sample for group in groups for sample in group]
    picked = np.random.default_rng([_PROBES, shown.order]).choice(len(everything), PROBES, replace=False)
    probes = [everything[index] for index in picked]
    network, answers, looks = Art2(shown.settings), list[int](), list[list[int]]()
    when = set(looked_at(shown.presentations))
    for number, sample in enumerate(order, start=1):
        answers.append(network.learn(sample.force_n, sample.torque_nm).state)
        if number in when:
            looks.append([network.classify(probe.force_n, probe.torque_nm).state for probe in probes])
    truths = [sample.truth for sample in order]
    return Learnt(
        np.bincount(answers, minlength=network.states).tolist(),
        looks,
        adjusted_rand_index(answers, numbered(truths)),
        purity(answers, numbered(truths)),
        adjusted_rand_index(answers, numbered([part_of(truth, 1) for truth in truths])),
        adjusted_rand_index(answers, numbered([part_of(truth, 0) for truth in truths])),
    )


def numbered(names: Sequence[str]) -> list[int]:
    """Return a number for each name, equal for equal ones."""
    numbers = {name: index for index, name in enumerate(sorted(set(names)))}
    return [numbers[name] for name in names]


def part_of(truth: str, part: int) -> str:
    """Return features (0) or octants (1) of a true contact state: of ``bore-2+mouth-2`` ``bore+mouth`` and ``2``."""
    return "+".join(sorted({(*point.split("-"), "")[part] for point in truth.split("+")}))


def in_order(groups: Sequence[Sequence[Sample]], order: int, presentations: int) -> list[Sample]:
    """Return so many vectors in the order in which they are shown; see ``Shown``."""
    samples: list[Sample] = []
    for again in range(presentations):
        if len(samples) >= presentations:
            break
        numbers = list(range(len(groups)))
        if (order, again) != (0, 0):
            np.random.default_rng([_ORDER, order, again]).shuffle(numbers)
        samples += [sample for number in numbers for sample in groups[number]]
    return samples[:presentations]


def looked_at(presentations: int) -> tuple[int, ...]:
    """Return after which presentations the probes are looked up, as in Table 4.3."""
    return (1, *range(LOOK_EVERY, presentations + 1, LOOK_EVERY))


def settled_at(presentations: Sequence[int], looks: Sequence[Sequence[int]]) -> int:
    """Return the first presentation looked at from which on no probe's class changes any more."""
    last = max((index for index in range(1, len(looks)) if list(looks[index]) != list(looks[index - 1])), default=0)
    return presentations[last]


def learnt(context: Context, what: str, sources: Sequence[Source], runs: Sequence[Shown]) -> list[Learnt]:
    """Return what came of the runs, in their order."""
    groups_of = {source.sha256: source.groups for source in sources}
    return context.pieces(what, runs, functools.partial(learn, groups_of), Learnt)
