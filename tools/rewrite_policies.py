"""Writes policies anew, in the format of today: the same weights and headers, to the byte.

`python tools/rewrite_policies.py FILE ...` is what config/policies went through when the digest
began to cover the header. A file that is of today's format already stays as it is.
"""

from pathlib import Path
import sys

from uav_collect.errors import PolicyMismatchError
from uav_collect.uav.policy_file import load_policy, policy_bytes, save_policy


def main(paths: list[str]) -> int:
    """Rewrite the policies; the exit status."""
    for path in map(Path, paths):
        try:
            policy = load_policy(path)
        except PolicyMismatchError as error:
            sys.stderr.write(f'error: {error}\n')
            return 2
        if path.read_bytes() != policy_bytes(policy):
            save_policy(path, policy)
            sys.stdout.write(f'{path}: written anew, version {policy.header.version}\n')
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
