"""Writes policies anew, in the format of today: the same weights and headers, to the byte.

`python tools/rewrite_policies.py FILE ...` is what config/policies went through when the digest
began to cover the header. A file that is of today's format already stays as it is.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # whether or not it is installed
from uav_collect.errors import PolicyMismatchError
from uav_collect.uav.policy_file import load_policy, policy_bytes, save_policy


def main(argv: Sequence[str] | None = None) -> int:
    """Rewrite the policies; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('paths', nargs='+', type=Path, metavar='FILE', help='policies')
    for path in parser.parse_args(argv).paths:
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
    sys.exit(main())
