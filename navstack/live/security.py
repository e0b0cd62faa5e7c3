"""Who may talk to the server: checks of the Host and Origin headers and of the token, and limits of rates."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Callable

CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy: nothing from elsewhere, no inline script."""
HEADERS = {
    "Content-Security-Policy": CSP,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
COOKIE = "navstack-live"


def is_loopback(host: str) -> bool:
    """True for an address that only this machine can reach."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Gate:
    """Decides who may enter. Beyond loopback a token is required."""

    def __init__(self, host: str, token: str | None = None) -> None:
        self._host = host
        self._loopback = is_loopback(host)
        self.token = token if token is not None else None if self._loopback else secrets.token_urlsafe(18)
        """None: no token is required."""

    def host_is_right(self, header: str | None) -> bool:
        """Checks the Host header: a name that DNS could point here (rebinding) is refused."""
        if not header:
            return False
        name = _without_port(header)
        if self._loopback:
            return name in ("localhost", "127.0.0.1", "::1", self._host)
        return name in (self._host, socket.gethostname()) or _is_address(name)

    def origin_is_right(self, origin: str | None, host: str | None) -> bool:
        """Checks the Origin header of a page: only pages of this server may connect."""
        return origin is not None and host is not None and origin == f"http://{host}"

    def token_is_right(self, *given: str | None) -> bool:
        """Checks the token of the address or of the cookie."""
        if self.token is None:
            return True
        return any(text is not None and hmac.compare_digest(text.encode(), self.token.encode()) for text in given)


def _without_port(header: str) -> str:
    if header.startswith("["):
        return header[1:].partition("]")[0]
    return header.rpartition(":")[0] if header.count(":") == 1 else header


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


class RateLimit:
    """Allows `rate` messages per second on average, and `burst` at once."""

    def __init__(self, rate: float, burst: float, timer: Callable[[], float]) -> None:
        self._rate, self._burst, self._timer = rate, burst, timer
        self._left, self._at = burst, timer()

    def allows(self) -> bool:
        """Counts a message; False if it is one too many."""
        now = self._timer()
        self._left = min(self._burst, self._left + (now - self._at) * self._rate)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
