"""The files that a world writes: the resolved scenario, and a log per mission."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
import os
from pathlib import Path

from uav_collect import files
from uav_collect.errors import RecordingError
from uav_collect.recording.mission_log import Events, FaultRecord, LogWriter, MissionHeader
from uav_collect.recording.origin import ORIGIN_FILE, origin_text

SCENARIO_FILE = 'scenario.yaml'  # resolved
BAG_FOLDER = 'bag'  # of a run folder, where its own recorder writes
METADATA_FILE = 'metadata.yaml'  # of a bag
PACKED = '.zstd'  # behind the name of a file that was packed as a whole
BAG_SUFFIXES = ('.mcap', '.db3', f'.mcap{PACKED}', f'.db3{PACKED}')


_LOGS = 'mission_*.jsonl'


def log_name(mission_seed: int, index: int | None = None) -> str:
    """The file of a mission's log.

    Args:
        index: running number of the mission in its world, if its seed was flown before.
    """
    again = '' if index is None else f'_{index}'
    return f'mission_{mission_seed}{again}.jsonl'


def check_without_logs(folder: Path) -> None:
    """Make sure that logs of a world would not come among, or in place of, those of another.

    Raises:
        RecordingError: the folder holds logs.
    """
    logs = sorted(folder.glob(_LOGS))
    if logs:
        raise RecordingError(
            f'{folder} holds logs of missions already, such as {logs[0].name}: choose another'
            ' folder, or move them away'
        )


def take_log(logs: dict[str, Path], mission_seed: int, index: int) -> Path | None:
    """Take the log of a mission out of those of a folder, by name; None if it is not there."""
    return logs.pop(log_name(mission_seed, index), None) or logs.pop(log_name(mission_seed), None)


def bag_files(folder: Path) -> list[Path]:
    """The files of a folder that hold messages of a bag."""
    return sorted(each for each in folder.iterdir() if each.name.endswith(BAG_SUFFIXES))


def is_bag(path: Path) -> bool:
    """Whether a path is meant to be a bag: its folder or its file, be it readable or not."""
    if path.is_dir():
        return (path / METADATA_FILE).is_file() or bool(bag_files(path))
    return path.name.endswith((*BAG_SUFFIXES, '.bag'))


def scenario_file(folder: Path, scenario_fingerprint: str) -> Path:
    """The file of a scenario in a folder: those after the first one have names of their own."""
    own = folder / f'scenario_{scenario_fingerprint}.yaml'
    return own if own.is_file() else folder / SCENARIO_FILE


class MissionFolder:
    """Writes them as long as the disk takes them; a mission goes on without.

    Each method says what went wrong, or None; the first failure of a mission ends its log.
    """

    def __init__(self, name: str) -> None:
        """Create the folder; with an empty name nothing is written.

        Raises:
            RecordingError: it holds logs of missions.
            OSError: it cannot be created, or written to.
        """
        self._folder = Path(name) if name else None
        self._log: LogWriter | None = None
        self._flown: set[int] = set()  # mission seeds
        self._has_scenario = False
        self._versions: dict[str, list[str]] = {}  # of the policies that flew, by name
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)
            if not os.access(self._folder, os.W_OK):
                raise PermissionError(f'{name} cannot be written to')
            check_without_logs(self._folder)

    def keep_scenario(self, text: str, scenario_fingerprint: str) -> str | None:
        """Write the resolved scenario of missions from now on, and by which code it is flown."""
        if self._folder is None:
            return None
        own = f'scenario_{scenario_fingerprint}.yaml'
        name = own if self._has_scenario else SCENARIO_FILE
        self._has_scenario = True
        try:
            files.write_atomically(self._folder / name, text.encode())
            self._keep_origin(self._folder)
        except OSError as error:
            return f'the scenario cannot be written: {error}'
        return None

    def begin(
        self, header: MissionHeader, index: int = 0, versions: Mapping[str, str] | None = None
    ) -> str | None:
        """Start the log of a mission.

        Args:
            index: running number of the mission in its world.
            versions: of the policies that fly it, by name.
        """
        self.end()
        if self._folder is None:
            return None
        try:
            seed = header.mission_seed
            path = self._folder / log_name(seed, index if seed in self._flown else None)
            self._flown.add(seed)
            self._log = LogWriter(path, header)
        except OSError as error:
            return f'the mission log cannot be written: {error}'
        try:
            self._note_versions(self._folder, versions or {})
        except OSError as error:
            return f'the versions of the policies cannot be written: {error}'
        return None

    def append(self, events: Events, faults: Sequence[FaultRecord] = ()) -> str | None:
        """Add events to the mission's log, and the faults that they were the first with."""
        if self._log is None:
            return None
        try:
            self._log.append(events, faults)
        except OSError as error:
            self.end()
            return f'the mission log cannot be written: {error}'
        return None

    def _note_versions(self, folder: Path, versions: Mapping[str, str]) -> None:
        """Keep versions of policies that have not flown before."""
        new = [it for it in versions.items() if it[1] not in self._versions.get(it[0], ())]
        for name, version in new:
            self._versions.setdefault(name, []).append(version)
        if new:
            self._keep_origin(folder)

    def _keep_origin(self, folder: Path) -> None:
        text = origin_text(self._versions)
        files.write_atomically(folder / ORIGIN_FILE, f'{text}\n'.encode())

    def end(self) -> None:
        """Close the mission's log."""
        log, self._log = self._log, None
        if log is not None:
            with suppress(OSError):  # what could not be written was said before
                log.close()
