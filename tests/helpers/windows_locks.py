"""The calls of Windows that lock bytes of a file, by locks of Linux that belong to an open file as those do."""

import errno
import struct

LK_NBLCK, LK_UNLCK = 2, 0


def locking(file, mode, count):
    """As ``msvcrt.locking`` from the first byte on: PermissionError if another open file has one of the bytes."""
    import fcntl

    kind = fcntl.F_WRLCK if mode == LK_NBLCK else fcntl.F_UNLCK
    try:
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, struct.pack("hhqqi", kind, 0, 0, count, 0))
    except BlockingIOError:
        raise PermissionError(errno.EACCES, "Permission denied") from None
