"""Errors of pqmesh: every one says what must hold, what was found where, and what to do."""


class PqmeshError(ValueError):
    """Base of all errors that a caller of pqmesh may cause."""


class MeshError(PqmeshError):
    """A mesh, or what was asked of it, is not valid."""


class SurfaceError(PqmeshError):
    """A surface is not regular, not finite, or not of the kind asked for."""


class NetworkError(PqmeshError):
    """No curve network, or no quad mesh of one, exists where it was asked for."""


class SpecError(PqmeshError):
    """A design or an option is not valid."""


class FormatError(PqmeshError):
    """A file does not follow its format."""
