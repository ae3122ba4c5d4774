"""How this process deals with the memory that arrays leave behind."""

import ctypes

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # names of glibc's mallopt
_LARGEST_ARRAY_BYTES = 32 * 2**20  # no larger threshold is taken
_KEPT_BYTES = 2**31 - 1


def keep_freed_memory() -> None:
    """Use what arrays leave behind again instead of handing it back to the system.

    An update makes and drops arrays of many megabytes; fetched from the system page by page each
    time, they took a tenth of it. Where malloc is not glibc's, nothing changes.
    """
    library = ctypes.CDLL(None)
    if hasattr(library, 'mallopt'):
        library.mallopt(_MMAP_THRESHOLD, _LARGEST_ARRAY_BYTES)
        library.mallopt(_TRIM_THRESHOLD, _KEPT_BYTES)
