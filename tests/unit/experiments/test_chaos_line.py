"""What a tap does with messages: all pass in order, unless it was told otherwise."""

from __future__ import annotations

from experiments.chaos.line import Faults, Line


def passed(faults: Faults, count: int, directions: tuple[str, ...] = ("near",)) -> tuple[list[int], Line]:
    """Return which messages have gone on, in order, right after the last one has come."""
    line, seen = Line(0), list[int]()
    line.faults = faults
    for number in range(count):
        line.message(directions[number % len(directions)], lambda number=number: seen.append(number))  # type: ignore[misc]
    return seen, line


def test_without_faults_all_pass_in_order() -> None:
    seen, line = passed(Faults(), 100)
    assert seen == list(range(100))
    assert line.counts == {"messages": 100}


def test_some_are_lost() -> None:
    seen, line = passed(Faults(lose=0.3), 1000)
    assert seen == sorted(seen)
    assert len(seen) == 1000 - line.counts["lost"]
    assert 200 < line.counts["lost"] < 400


def test_each_is_overtaken_by_the_next_of_its_direction() -> None:
    assert passed(Faults(reorder=1.0), 6)[0] == [1, 0, 3, 2, 5, 4]
    assert passed(Faults(reorder=1.0), 8, ("near", "far"))[0] == [2, 0, 3, 1, 6, 4, 7, 5]


def test_what_comes_twice_or_late_comes_in_the_end() -> None:
    line, seen = Line(0), list[int]()

    def arrive(number: int) -> None:
        seen.append(number)
        line.stopping = len(seen) == 10

    line.faults = Faults(repeat=1.0, delay=1.0)
    for number in range(5):
        line.message("near", lambda number=number: arrive(number))  # type: ignore[misc]
    assert seen == []
    line.work()
    assert sorted(seen) == sorted([*range(5), *range(5)])
    assert line.counts == {"messages": 5, "repeated": 5, "delayed": 5}
