"""Agreement of classes with true contact states, by hand-worked numbers, and the little program around it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.lab import contact_states
from experiments.lab.agreement import adjusted_rand_index, contingency, purity
from services.wire.definition import Art2Settings, Definition, Limits, Parts

LABELS = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=1, max_size=40)


def test_contingency_by_hand() -> None:
    assert contingency([7, 7, 3, 7], [0, 1, 1, 1]).tolist() == [[0, 1], [1, 2]]


def test_adjusted_rand_index_by_hand() -> None:
    # Pairs together in both: C(2,2) + C(1,2) + C(3,2) = 1 + 0 + 3 = 4; of rows 3, 3: 3 + 3 = 6; of columns 2, 4:
    # 1 + 6 = 7; of all six 15. Chance is 6 * 7 / 15 = 2.8, so (4 - 2.8) / (6.5 - 2.8).
    assert adjusted_rand_index([0, 0, 0, 1, 1, 1], [0, 0, 1, 1, 1, 1]) == pytest.approx(1.2 / 3.7)


def test_adjusted_rand_index_can_be_below_chance() -> None:
    # Nothing together in both, 2 pairs in each, 6 in all: chance 4/6, so (0 - 2/3) / (2 - 2/3) = -1/2.
    assert adjusted_rand_index([0, 0, 1, 1], [0, 1, 0, 1]) == pytest.approx(-0.5)


def test_purity_by_hand() -> None:
    # Of the first group 2 of 3 are the commonest, of the second 3 of 3.
    assert purity([0, 0, 0, 1, 1, 1], [0, 0, 1, 1, 1, 1]) == pytest.approx(5 / 6)


def test_one_group_tells_nothing() -> None:
    assert adjusted_rand_index([0] * 6, [0, 0, 1, 1, 2, 2]) == 0.0
    assert purity([0] * 6, [0, 0, 1, 1, 2, 2]) == pytest.approx(1 / 3)


@pytest.mark.parametrize("labels", [[0], [0, 0], [0, 1, 2]])
def test_trivial_partitions_agree_with_themselves(labels: list[int]) -> None:
    assert adjusted_rand_index(labels, labels) == 1.0


@given(LABELS)
def test_names_and_order_of_labels_do_not_matter(pairs: list[tuple[int, int]]) -> None:
    found, true = [a for a, _ in pairs], [b for _, b in pairs]
    index = adjusted_rand_index(found, true)
    assert index <= 1.0
    assert adjusted_rand_index(true, found) == pytest.approx(index)
    assert adjusted_rand_index([9 - a for a in reversed(found)], list(reversed(true))) == pytest.approx(index)
    assert adjusted_rand_index(found, found) == 1.0
    assert purity(found, found) == 1.0


@pytest.mark.parametrize("found, true", [([], []), ([0], [0, 1])])
def test_labellings_that_do_not_fit_are_refused(found: list[int], true: list[int]) -> None:
    with pytest.raises(ValueError, match="labels: expected as many of both"):
        contingency(found, true)


def clusters(count: int) -> list[contact_states.Sample]:
    """Samples that point one of four ways, in turn, a little apart."""
    samples = []
    for number in range(count):
        angle = number % 4 * math.pi / 2 + 0.02 * math.sin(number)
        force_n = (2.0 * math.cos(angle), 2.0 * math.sin(angle), -1.0)
        samples.append(contact_states.Sample(force_n, (0.0, 0.0, 0.0), f"bore-{number % 4 * 2}"))
    return samples


def test_clear_contact_states_are_found_as_they_are() -> None:
    found = contact_states.score(Art2Settings(rho=0.97), [clusters(100), clusters(60)])
    assert (found.classes, found.ari, found.purity, found.changes) == (4.0, 1.0, 1.0, 0.0)


def test_the_spread_is_that_between_runs() -> None:
    clear, blurred = clusters(100), [sample._replace(truth="bore-0") for sample in clusters(100)]
    found = contact_states.score(Art2Settings(rho=0.97), [clear, blurred])
    # Indices 1 and 0, and so a mean of 1/2 and a standard deviation of sqrt(2 * 0.25 / 1).
    assert found.ari == 0.5
    assert found.ari_spread == pytest.approx(math.sqrt(0.5))
    assert contact_states.score(Art2Settings(rho=0.97), [clear]).ari_spread == 0.0


def test_too_little_vigilance_confuses_contact_states() -> None:
    found = contact_states.score(Art2Settings(rho=0.5), [clusters(100)])
    assert (found.classes, found.purity) == (2.0, 0.5)
    # Four true states of 25 in two classes of 50: pairs together 4 * 300 in both, as many in truth, 2 * 1225 in the
    # classes, of 4950 in all.
    chance = 2450 * 1200 / 4950
    assert found.ari == pytest.approx((1200 - chance) / (1825 - chance))


def test_the_grid_has_every_combination_once() -> None:
    grid = contact_states.grid(Art2Settings(capacity=50))
    assert len(grid) == len(set(grid)) == 9 * 4 * 2 * 2 * 4
    assert {settings.capacity for settings in grid} == {50}
    assert Art2Settings(capacity=50) in grid


def test_one_at_a_time_leaves_out_double_changes() -> None:
    def score(rho: float, theta: float) -> contact_states.Score:
        return contact_states.Score(rho, theta, "odd", 0.1, 10.0, 1, 0, 0, 1, 0)

    base = score(0.94, 0.05)
    others = [score(0.95, 0.05), score(0.94, 0.0), score(0.95, 0.0)]
    assert contact_states.one_at_a_time(others, base) == others[:2]


def test_a_run_is_recorded_with_what_truly_touches() -> None:
    definition = Definition(
        name="short", parts=Parts(clearance_mm=0.5), limits=Limits(success_fraction=0.1, move_limit=40)
    )
    samples = contact_states.record(definition, 0, 2)
    assert len(samples) > 10
    assert samples == contact_states.record(definition, 0, 2)
    # The peg hangs too far to +X and -Y, so it touches there first.
    assert samples[0].truth == "chamfer-7"
    for sample in samples:
        assert math.hypot(*sample.force_n) >= definition.limits.contact_force_n
        assert sample.truth != "free"
