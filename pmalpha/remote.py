"""The earlier place of `pmalpha.rig.calls`: functions of other processes."""

from .rig.calls import Client, RemoteError, serve, started

__all__ = ["Client", "RemoteError", "serve", "started"]


def __dir__() -> list[str]:
    return sorted(__all__)
