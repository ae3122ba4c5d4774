"""Lists the licences of what is installed, and refuses what is unknown or not permitted.

    python tools/licences.py [--list]

A licence is that of the package's metadata, or of the package.xml of a ROS package. The exit
status is 1 if a package has none that is known and permitted.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from importlib.metadata import Distribution, distributions
from pathlib import Path
import re
import sys

# Whoever uses or ships this project may use what comes under these, changed or not.
_PERMITTED = {
    '0BSD',
    'Apache-2.0',
    'Apache-2.0 WITH LLVM-exception',
    'BSD-2-Clause',
    'BSD-3-Clause',
    'BSL-1.0',
    'CC0-1.0',
    'ISC',
    'MIT',
    'MIT-0',
    'MIT-CMU',
    'MPL-2.0',
    'PSF-2.0',
    'Zlib',
}
# What authors call them.
_OTHER_NAMES = {
    '3-Clause BSD License': 'BSD-3-Clause',
    'Apache 2.0': 'Apache-2.0',
    'Apache License 2.0': 'Apache-2.0',
    'Apache License, Version 2.0': 'Apache-2.0',
    'Apache Software License': 'Apache-2.0',
    'BSD': 'BSD-3-Clause',
    'BSD License': 'BSD-3-Clause',
    'MIT License': 'MIT',
    'Mozilla Public License 2.0 (MPL 2.0)': 'MPL-2.0',
    'Python Software Foundation License': 'PSF-2.0',
    'zlib License': 'Zlib',
}
# Looked up by hand: the metadata say nothing, or not which file has which.
_LOOKED_UP = {
    'apsw': 'Zlib',  # "any OSI approved licence"
    'docutils': 'BSD-2-Clause',  # of what is imported; its GPL file is an Emacs mode
    'ros-fastcdr': 'Apache-2.0',
    'ros-fastrtps': 'Apache-2.0',
    'setuptools': 'MIT',
}
# Never shipped and never imported but by tests, which read with it what is written here.
_LGPL = 'GNU Library or Lesser General Public License (LGPL)'
_TESTS_ONLY = {
    'fastkml': _LGPL,
    'pygeoif': _LGPL,  # of fastkml
    'pymavlink': 'GNU Lesser General Public License v3 (LGPLv3)',
}
_NVIDIA = ('cuda-', 'nvidia-')  # come with torch where there is a GPU, under NVIDIA's own terms


def main(arguments: Sequence[str]) -> int:
    """Print what is not permitted, or how many packages there are; the exit status."""
    found = {it.metadata['Name']: licence_of(it) for it in _installed()}
    if '--list' in arguments:
        width = max(map(len, found))
        for name, licence in sorted(found.items()):
            print(f'{name:{width}}  {licence}')
    refused = {name: it for name, it in found.items() if not is_permitted(name, it)}
    for name, licence in sorted(refused.items()):
        print(f'error: {name}: its licence is {licence or "unknown"}: see tools/licences.py')
    if not refused:
        kinds = ', '.join(f'{kind} {n}' for kind, n in Counter(found.values()).most_common(3))
        print(f'licences of {len(found)} packages: permitted ({kinds}, ...)')
    return 1 if refused else 0


def _installed() -> Iterator[Distribution]:
    """What is in this virtual environment, and not in the system below it."""
    yield from distributions(path=[it for it in sys.path if it.startswith(sys.prefix)])


def licence_of(installed: Distribution) -> str:
    """The licence as an SPDX expression, where it is known; '' where there is none."""
    metadata, name = installed.metadata, installed.metadata['Name']
    if name in _LOOKED_UP:
        return _LOOKED_UP[name]
    if expression := metadata.get('License-Expression'):
        return expression
    classifiers = [it.split(' :: ') for it in metadata.get_all('Classifier') or ()]
    names = [it[-1] for it in classifiers if it[0] == 'License' and it[-1] != 'OSI Approved']
    names = names or [*filter(None, [(metadata.get('License') or '').strip()])] or _of_ros(name)
    return ' AND '.join(_OTHER_NAMES.get(it, it) for it in names)


def _of_ros(name: str) -> list[str]:
    """The licences that a ROS package's manifest names."""
    package = re.sub('^ros-(jazzy-)?', '', name).replace('-', '_')
    manifest = Path(sys.prefix) / 'share' / package / 'package.xml'
    if not manifest.is_file():
        return []
    return re.findall(r'<license[^>]*>(.*?)</license>', manifest.read_text(encoding='utf-8'))


def is_permitted(name: str, expression: str) -> bool:
    """Whether a package may be used under one of the choices that its licence gives."""
    if name.startswith(_NVIDIA) or _TESTS_ONLY.get(name) == expression:
        return True
    choices = expression.split(' OR ')
    return any({*choice.split(' AND ')} <= _PERMITTED for choice in choices)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
