"""How a disk refuses.

DiskError                 the protocol tells the controller in its own codes
+-- ProtectedError        it must not be written
+-- DamageError           it could not be written, or what was to be written makes no sense
"""

from __future__ import annotations


class DiskError(Exception):
    """A disk refuses a transfer; the message is for the person at the host. Nothing was damaged."""


class ProtectedError(DiskError):
    """What was to be written must not be."""


class DamageError(DiskError):
    """It could not be read or written (the host's disk is full, for instance), or it contradicts itself."""


class MissingError(DiskError):
    """The folder behind the disk is gone."""
