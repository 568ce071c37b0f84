"""The earlier place of `pmalpha.rig.remote`: functions of other processes."""

from .rig.remote import Client, RemoteError, serve, started

__all__ = ["Client", "RemoteError", "serve", "started"]
