"""The swaps of the task's run: asked for by a query, kept by the store before they are acknowledged.

A swap that the store was given may reach it whether or not it confirms that in time: from then on it belongs to the
run, and no episode begins before the store has given it back.
"""

from __future__ import annotations

import logging

from services.bus.service import Service
from services.rules.plugins import PluginError
from services.rules.swaps import check_episode, swap_for, words
from services.task.journal import read, wait_for_store
from services.wire import messages
from services.wire.errors import CellError, NoAnswerError, SwapError
from services.wire.keys import SWAPS, name_of
from services.wire.messages import RunRecord, Swap, Swapped, SwapRequest


class Swaps:
    """What is swapped in the course of one run."""

    def __init__(self, service: Service, record: RunRecord) -> None:
        self._service = service
        self._record = record
        self._all: tuple[Swap, ...] = ()
        self.confirmed: tuple[Swap, ...] = ()
        """Those that the store has given back; the rest come after them."""

    def resume(self, stored: tuple[Swap, ...]) -> None:
        """Take over what the store has. Raises CellError for what no request can have made."""
        record = self._record
        earlier: tuple[Swap, ...] = ()
        for swap in stored:
            request = SwapRequest(
                run=record.run,
                request=swap.request,
                episode=swap.episode,
                classifier=swap.classifier,
                learner=swap.learner,
                policy=swap.policy,
            )
            try:
                expected = swap_for(record.definition, earlier, request, swap.episode)
            except (SwapError, PluginError) as error:
                raise CellError(f"store: {self._name}: swap {len(earlier) + 1} cannot be: {error}") from error
            if swap != expected:
                raise CellError(f"store: {self._name}: swap {len(earlier) + 1}: expected {expected}, got {swap}")
            earlier += (swap,)
        self._all = self.confirmed = earlier

    def ask(self, request: SwapRequest, first: int, episodes: int) -> Swapped:
        """Do what a request asks for, in an episode from ``first`` on, and return it once the store has it.

        Raises SwapError or PluginError; a SwapError also when the store does not confirm it now:
        whoever asks again with the same request learns what became of it.
        """
        record = self._record
        if request.run != record.run:
            raise SwapError(f"swap: expected run {record.run}, got {request.run}", "foreign_run")
        number = self._number(request)
        if number is None:
            self._add(request, first, episodes)
            number = len(self._all) - 1
        if number >= len(self.confirmed) and not self._confirm():
            raise SwapError("swap: the store does not confirm it; ask again with the same request", "not_ready")
        return Swapped(run=record.run, number=number + 1, swap=self._all[number])

    def plan(self, planned: tuple[Swap, ...], first: int) -> None:
        """Add swaps that the run shall have from its beginning, unless it has them. Raises SwapError if it is late."""
        names = {swap.request for swap in self._all}
        missing = tuple(swap for swap in planned if swap.request not in names)
        if missing and (missing[0].episode < first or self._all):
            got = f"a run that stands before episode {first} with {len(self._all)} other swaps"
            raise SwapError(f"--swap: expected a run in which episode {missing[0].episode} has not begun, got {got}")
        self._all += missing

    def settle(self) -> bool:
        """Wait until the store has all swaps, as long as it takes; False when stopped meanwhile."""
        service = self._service
        # Each try gives the store all there are by then: whoever asks meanwhile must not lose what was acknowledged.
        while self.confirmed != self._all and not self._confirm():
            if service.stopping:
                return False
            wait_for_store(service, "it does not confirm a swap")
        return True

    def _add(self, request: SwapRequest, first: int, episodes: int) -> None:
        if request.after not in (None, len(self._all)):
            expected = f"expected one worked out after the run's {len(self._all)} swaps"
            got = f"got one after {request.after}; look at the run and ask again"
            raise SwapError(f"swap: {expected}, {got}", "out_of_order")
        episode = first if request.episode is None else request.episode
        check_episode(episode, first, episodes)
        self._all += (swap_for(self._record.definition, self._all, request, episode),)

    def _number(self, request: SwapRequest) -> int | None:
        """Return which swap a request that came before has become. Raises SwapError when it was another request."""
        for number, swap in enumerate(self._all):
            if swap.request == request.request:
                tables = (swap.classifier, swap.learner, swap.policy)
                same = tables == (request.classifier, request.learner, request.policy)
                if not same or request.episode not in (None, swap.episode):
                    raise SwapError(f"swap: expected request {swap.request} to ask for the same again, got another")
                return number
        return None

    def _confirm(self) -> bool:
        """Give the store all swaps, and return whether it gives them back at once."""
        wanted = self._message(self._all)
        self._service.put(self._key, wanted)
        try:
            if read(self._service, self._name, messages.Swaps) != wanted:
                return False
        except NoAnswerError:
            return False
        self._note(wanted.swaps)
        return True

    def _note(self, confirmed: tuple[Swap, ...]) -> None:
        for swap in confirmed[len(self.confirmed) :]:
            self._service.log.log(logging.WARNING if swap.fresh else logging.INFO, "swap: %s", words(swap))
        self.confirmed = confirmed

    def _message(self, swaps: tuple[Swap, ...]) -> messages.Swaps:
        return messages.Swaps(run=self._record.run, swaps=swaps)

    @property
    def _key(self) -> str:
        return self._service.keys.swaps(self._record.run)

    @property
    def _name(self) -> str:
        return name_of(SWAPS, run=self._record.run)
