"""Files of caches that steer a command or hold code: they are read only if they are the user's own.

Such a file and its folder must belong to the user or to root, and nobody else may write to them. A
folder with the sticky bit may be written to by others, who cannot replace the user's files in it.
Windows has no numbers of users; there the rights of folders, which Python does not see, decide.
"""

import logging
import os
import stat
from pathlib import Path

from resample.reading.limits import check_size

try:
    import grp
    import pwd
except ImportError:  # Windows
    grp = pwd = None  # type: ignore[assignment]

LOG = logging.getLogger("resample")
BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
ROOT = 0
UNBLOCKED = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


class NotOwnError(PermissionError):
    """A file that would steer a command is another user's, or others may write to it."""


def own_bytes(path: Path, limit: str | None = None) -> bytes:
    """Content of a file that nobody but the user, or root, can have written; links are rejected.

    `limit`: name of the limit on its size, see `resample.reading.limits`; None: there is none.
    """
    check_own(path.parent)
    with open(os.open(path, os.O_RDONLY | UNBLOCKED), "rb") as file:
        status = os.fstat(file.fileno())
        _check(path, status)
        if limit is not None:
            check_size(str(path), status.st_size, limit)
        return file.read()


def tell_unused(error: NotOwnError, variable: str) -> None:
    """Warn that a file is not used; `variable` names the folder of the cache."""
    LOG.warning("%s: it is not used; %s may name another folder", error, variable)


def check_own(path: Path) -> None:
    """Reject a file or folder that is another's, or that others may write to."""
    _check(path, os.stat(path))


def _check(path: Path, status: os.stat_result) -> None:
    if pwd is None:
        return
    if status.st_uid not in (os.geteuid(), ROOT):
        owner = _name_of(status.st_uid)
        raise NotOwnError(f"{path} belongs to {owner} and would steer your commands")
    is_sticky = stat.S_ISDIR(status.st_mode) and status.st_mode & stat.S_ISVTX
    if status.st_mode & BY_OTHERS and not is_sticky and not _is_private(status):
        raise NotOwnError(
            f"{path} would steer your commands, and others may write to it (chmod go-w)"
        )


def _is_private(status: os.stat_result) -> bool:
    """Whether only the owner's own group may write: many systems give each user one."""
    try:
        group = grp.getgrgid(status.st_gid)
    except KeyError:
        return False
    owner = _name_of(status.st_uid)
    is_owners = group.gr_name == owner and not set(group.gr_mem) - {owner}
    return is_owners and not status.st_mode & stat.S_IWOTH


def _name_of(user: int) -> str:
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return f"user {user}"
