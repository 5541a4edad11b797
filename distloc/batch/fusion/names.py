"""Names of fused fires that stay when fires split, merge or lose what tells of them."""

from collections.abc import Mapping, Sequence

from distloc.batch.fusion.claims import FusedFire


class Names:
    """Keeps the last names alone: as many as there are claims.

    A fire is named after the claim that came first, so that all who heard the same say the same; it keeps that name
    when that claim goes. Where two fires become one the older name stays; where one becomes two it goes with most of
    its claims, of halves with the first one's.
    """

    def __init__(self) -> None:
        self.fire_of: dict[str, str] = {}
        self._order: list[str] = []  # the oldest first
        self._joined: set[str] = set()

    def name(self, fires: Sequence[FusedFire], since_s: Mapping[str, float]) -> list[str]:
        """The name of each; `since_s` says since when each claim has been known."""
        members = [(*one.used, *one.undecided) for one in fires]
        votes: dict[str, dict[int, int]] = {}
        for index, own in enumerate(members):
            for claim in own:
                if claim in self.fire_of:
                    mine = votes.setdefault(self.fire_of[claim], {})
                    mine[index] = mine.get(index, 0) + 1
        found: dict[int, str] = {}
        for name in self._order:
            mine = votes.get(name, {})
            ranked = sorted(mine, key=lambda index: (-mine[index], name not in members[index], members[index]))
            if ranked and ranked[0] not in found:
                found[ranked[0]] = name
        taken = set(found.values())
        fresh = []
        for index in sorted(set(range(len(fires))) - found.keys(), key=lambda one: members[one]):
            first = sorted(members[index], key=lambda claim: (since_s.get(claim, 0.0), claim))
            found[index] = next((one for one in first if one not in taken), f"{first[0]}+")
            while found[index] in taken:
                found[index] += "+"
            taken.add(found[index])
            fresh.append(found[index])
        self._order = [one for one in self._order if one in taken and one not in fresh] + fresh
        self.fire_of = {claim: found[index] for index, own in enumerate(members) for claim in own}
        joined = {found[index] for index, one in enumerate(fires) if len(members[index]) > 1 or one.bearings}
        self._joined = (self._joined & taken) | joined
        return [found[index] for index in range(len(fires))]

    def is_joined(self, name: str) -> bool:
        """Whether several tell of it, or did."""
        return name in self._joined
