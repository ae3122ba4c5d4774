"""Finds out whether a Ray cluster lets this process in, and says in one line why not.

Ray itself tries for minutes, with a line of its own each second. So another process tries first,
and is ended at the first line that says what is wrong.
"""

from collections.abc import Iterator
import os
import subprocess
import sys

from uav_collect.errors import ClusterError

_TRY = """
import sys
import ray
try:
    ray.init(address=sys.argv[1], log_to_driver=False, logging_level='ERROR')
except Exception as error:
    print(type(error).__name__, ' '.join(str(error).split()))
    sys.exit(1)
"""
_SOURCES = 'RAY_AUTH_TOKEN, RAY_AUTH_TOKEN_PATH or ~/.ray/auth_token'  # of the token


def check_address(address: str) -> None:
    """See that the cluster at an address can be joined.

    Raises:
        ClusterError: it cannot be reached, takes no token of this process, or runs another Ray or
            Python.
    """
    command = [sys.executable, '-c', _TRY, address]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as trying:
        try:
            for line in _lines(trying):
                if (why := reason_in(line)) is not None:
                    raise ClusterError(f'--address {address}: {why}')
            if trying.wait() != 0:
                raise ClusterError(
                    f'--address {address}: Ray ends with status {trying.returncode}'
                )
        finally:
            trying.kill()


def _lines(process: 'subprocess.Popen[str]') -> Iterator[str]:
    yield from process.stdout or ()


def reason_in(line: str) -> str | None:
    """What a line of Ray's says is wrong; None where it says nothing of the kind."""
    if 'InvalidAuthToken' in line:
        if os.environ.get('RAY_AUTH_MODE', '').lower() != 'token':
            return f'asks for a token: set RAY_AUTH_MODE=token, and the token by {_SOURCES}'
        return f'the token is wrong: {_SOURCES} must hold the one that the cluster has'
    if line.startswith('AuthenticationError'):
        return f'RAY_AUTH_MODE is token, but there is no token: {_SOURCES} must hold it'
    if 'Failed to connect to GCS' in line or line.startswith('ConnectionError'):
        return 'no cluster answers there: must be HOST:PORT of its head, or auto on its machines'
    name, _, text = line.partition(' ')
    return text.strip() if name.endswith(('Error', 'Exception')) else None
