"""The byte-range locks of Windows, emulated by Linux locks that likewise belong to an open file."""

import errno
import os
import struct

LK_LOCK, LK_NBLCK, LK_UNLCK = 1, 2, 0


def locking(file, mode, count):
    """As ``msvcrt.locking`` for the next ``count`` bytes: PermissionError if another open file holds one of them."""
    import fcntl

    kind = fcntl.F_UNLCK if mode == LK_UNLCK else fcntl.F_WRLCK
    try:
        fcntl.fcntl(
            file,
            fcntl.F_OFD_SETLKW if mode == LK_LOCK else fcntl.F_OFD_SETLK,
            struct.pack("hhqqi", kind, os.SEEK_SET, os.lseek(file, 0, os.SEEK_CUR), count, 0),
        )
    except BlockingIOError:
        raise PermissionError(errno.EACCES, "Permission denied") from None
