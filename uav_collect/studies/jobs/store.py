"""Keeps the results of jobs, one folder per job: whole or not at all.

    STORE/jobs/DIGEST/      job.json, cost.json and the files that came out
    STORE/states/DIGEST     what an unfinished job goes on from
    STORE/failures/DIGEST   where a job failed
    STORE/reserved          locked by who does which job

Folders may be copied between machines; several processes may write one store.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
import json
import os
from pathlib import Path
import shutil

from uav_collect import files
from uav_collect.errors import StoreError
from uav_collect.studies.jobs.jobs import digest_of, Job, to_json
from uav_collect.studies.jobs.worker_messages import Cost

_JOB = 'job.json'
_COST = 'cost.json'


class Store:
    """Results of jobs, by the digest of the job."""

    def __init__(self, folder: Path) -> None:
        """Use a folder, which is made when something is kept."""
        self.folder = folder

    def has(self, digest: str) -> bool:
        """Whether a job is done."""
        return (self.folder / 'jobs' / digest / _COST).is_file()

    def missing(self, digests: Iterable[str]) -> list[str]:
        """The jobs that are not done, by digest."""
        return [digest for digest in digests if not self.has(digest)]

    def read(self, digest: str, name: str) -> bytes:
        """A file that a job gave.

        Raises:
            StoreError: the job is not done, or gave no such file.
        """
        path = self.folder / 'jobs' / digest / name
        try:
            return path.read_bytes()
        except OSError as error:
            raise StoreError(f'{path}: cannot be read: {error.strerror}') from error

    def cost(self, digest: str) -> Cost:
        """What a job took.

        Raises:
            StoreError: the job is not done.
        """
        try:
            return Cost(**json.loads(self.read(digest, _COST)))
        except (ValueError, TypeError) as error:
            path = self.folder / 'jobs' / digest / _COST
            raise StoreError(f'{path}: is no cost of a job: {error}') from error

    def save(self, job: Job, results: Mapping[str, bytes], cost: Cost) -> None:
        """Keep what a finished job gave; its state goes, and why it failed before.

        Raises:
            OSError: the disk does not take it.
        """
        digest = digest_of(job)
        folder = self.folder / 'jobs' / digest
        if not self.has(digest):
            content = (json.dumps(asdict(cost), indent=1) + '\n').encode()
            self._write_folder(folder, {_JOB: to_json(job), **results, _COST: content})
        self._state(digest).unlink(missing_ok=True)
        self._failure(digest).unlink(missing_ok=True)

    def _write_folder(self, folder: Path, contents: Mapping[str, bytes]) -> None:
        partial = folder.with_name(f'.{folder.name}.{os.uname().nodename}.{os.getpid()}.part')
        shutil.rmtree(partial, ignore_errors=True)  # of one that was killed and had our number
        try:
            with files.naming(folder):
                partial.mkdir(parents=True)
                for name, content in contents.items():
                    files.write_atomically(partial / name, content)
                if not self.has(folder.name):  # a copy that was cut off may be there
                    shutil.rmtree(folder, ignore_errors=True)
                partial.rename(folder)
        except OSError:
            if not self.has(folder.name):  # someone else was faster: the bytes are the same
                raise
        finally:
            shutil.rmtree(partial, ignore_errors=True)

    def save_state(self, digest: str, state: bytes) -> None:
        """Keep what an unfinished job goes on from, in place of what was kept before.

        Raises:
            OSError: the disk does not take it; the last one is still there.
        """
        path = self._state(digest)
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write_atomically(path, state)

    def state(self, digest: str) -> bytes | None:
        """What an unfinished job goes on from; None: from its beginning."""
        try:
            return self._state(digest).read_bytes()
        except FileNotFoundError:
            return None

    def drop_state(self, digest: str) -> None:
        """Forget a state that nothing can go on from."""
        self._state(digest).unlink(missing_ok=True)

    def save_failure(self, digest: str, trace: str) -> None:
        """Keep why a job cannot be done, for who is to mend it."""
        path = self._failure(digest)
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write_atomically(path, trace.encode())

    def _failure(self, digest: str) -> Path:
        return self.folder / 'failures' / f'{digest}.txt'

    def _state(self, digest: str) -> Path:
        return self.folder / 'states' / digest
