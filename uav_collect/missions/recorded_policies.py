"""Finds the policies by which recorded missions were flown, and says where they have changed."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from uav_collect.errors import PolicyMismatchError
from uav_collect.limits import is_lookahead_name, NO_AGENT
from uav_collect.lockstep.published_policy import checked_policy, PolicyKey, PublishedPolicy
from uav_collect.missions.reflight import FlownBy
from uav_collect.recording.mission_log import MissionHeader, UavHeader
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.briefing import Briefing, briefing_of
from uav_collect.uav.policy import guard_for, NamedPolicy, policy_named
from uav_collect.uav.policy_file import load_policy, SUFFIX
from uav_collect.uav.policy_network import flown_version, LearnedPolicy


@dataclass(frozen=True, kw_only=True)
class Crew:
    """Who may have flown the UAVs of a mission."""

    members: tuple[FlownBy | None, ...]  # by UAV; None: the failsafe alone
    changes: tuple[str, ...]  # policies that have another version now than then, in words


class RecordedPolicies:
    """Policies out of files, of the package, and published ones of a recording."""

    def __init__(self, files: Iterable[Path] = (), published: Sequence[Any] = ()) -> None:
        """Look in these places.

        Args:
            files: of learned policies, which count before shipped ones of the same name; and names
                of functions, module:name, whose code may be run because a recording names it.
            published: Policy messages; more may come.
        """
        given = [*files]
        self._functions = {str(each) for each in given if ':' in str(each)}
        self._files = [each for each in given if str(each) not in self._functions]
        self._published = published
        self._named: dict[str, list[NamedPolicy]] = {}  # what was found before
        self._checked: dict[tuple[PolicyKey, str], PublishedPolicy] = {}  # by scenario, too

    def crew(
        self,
        header: MissionHeader,
        site: Site,
        versions: Mapping[int, str],
        key: PolicyKey | None = None,
    ) -> Crew:
        """Who flew a mission.

        Args:
            header: of its log.
            versions: of policies, as far as they were recorded, by id of the UAV.
            key: of the published policy that observations name.

        Raises:
            PolicyMismatchError: a policy is not here, or it is broken; names the UAV.
        """
        members: list[FlownBy | None] = []
        changes: dict[str, None] = {}
        for uav in header.uavs:
            if uav.policy == NO_AGENT:
                members.append(None)
                continue
            try:
                member = self._published_one(uav, header.mission_seed, site, key)
                if member is None:
                    member, change = self._named_one(uav, versions.get(uav.id), briefing_of(site))
                    changes.update({change: None} if change else {})
            except PolicyMismatchError as error:
                raise PolicyMismatchError(f'UAV {uav.id}: {error}') from error
            members.append(member)
        return Crew(members=tuple(members), changes=tuple(changes))

    def _published_one(
        self, uav: UavHeader, mission_seed: int, site: Site, key: PolicyKey | None
    ) -> FlownBy | None:
        """Who followed a trainer; None if no published policy is called so."""
        alike = [
            msg for msg in self._published if flown_version(msg.version, msg.epsilon) == uav.policy
        ]
        exact = [msg for msg in alike if (msg.trainer_instance, msg.sequence) == key]
        if not alike:
            return None
        msg = (exact or alike)[-1]
        known = (msg.trainer_instance, msg.sequence), fingerprint(site.scenario)
        if known not in self._checked:
            self._checked[known] = checked_policy(msg, briefing_of(site))
        policy = self._checked[known].for_mission(mission_seed)
        # A learner is to see what its own policy does: nobody guards it.
        return FlownBy(policy=policy, allocator=uav.allocator, guard_after=NONE)

    def _named_one(
        self, uav: UavHeader, version: str | None, briefing: Briefing
    ) -> tuple[FlownBy, str | None]:
        if uav.policy not in self._named:
            self._named[uav.policy] = self._versions_of(uav.policy)
        found = self._named[uav.policy]
        policy = next((it for it in found if it.version == version), found[0])
        change = None
        if version is not None and policy.version != version:
            change = f'policy {uav.policy} is of version {policy.version} now, of {version} then'
        guard_after = guard_for(policy, uav.guard_after, briefing)
        return FlownBy(
            policy=replace(policy), allocator=uav.allocator, guard_after=guard_after
        ), change

    def _versions_of(self, name: str) -> list[NamedPolicy]:
        """The policies that a name may mean, at least one."""
        is_code = ':' in name and ' eps ' not in name and not is_lookahead_name(name)
        if is_code and name not in self._functions:
            raise PolicyMismatchError(
                f'policy {name!r} is code that the recording names: run it with --policy {name}'
            )
        found: list[NamedPolicy] = []
        for file in self._files:
            frozen = load_policy(file)
            if name in (file.stem, frozen.header.version):
                found.append(LearnedPolicy(name=name, frozen=frozen))
        try:
            found.append(policy_named(name))
        except PolicyMismatchError as error:
            if is_code or is_lookahead_name(name):
                raise
            if not found:
                raise PolicyMismatchError(
                    f'policy {name!r} is not here: give its {SUFFIX} file with --policy, or a bag'
                    ' that has it if a trainer has published it'
                ) from error
        return found
