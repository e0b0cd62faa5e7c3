"""The command line. Heavy modules are imported by the command that needs them."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.cli.app import main as main
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
