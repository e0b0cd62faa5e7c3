"""Watch a robot drive and take part: a session of a running simulation, and the page in the browser that shows it.

`session.py` and the modules next to it know nothing of the web; `server.py` connects them to pages. Needs aiohttp (extra `live`)
for the server only.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.live.checkpoints import Origin as Origin
    from navstack.live.fleet import FleetSession as FleetSession
    from navstack.live.foxglove import FoxgloveServer as FoxgloveServer
    from navstack.live.graph import GraphEditor as GraphEditor
    from navstack.live.logged import LoggedSession as LoggedSession
    from navstack.live.server import Gate as Gate
    from navstack.live.server import LiveServer as LiveServer
    from navstack.live.server import ServerThread as ServerThread
    from navstack.live.server import is_loopback as is_loopback
    from navstack.live.server import serve as serve
    from navstack.live.session import MAX_SPEED as MAX_SPEED
    from navstack.live.session import Session as Session
    from navstack.live.stage import COMPILING as COMPILING
    from navstack.live.stage import Options as Options
    from navstack.live.stage import Report as Report
    from navstack.live.stage import Stage as Stage
    from navstack.live.stage import free_pose as free_pose
    from navstack.live.watched import WatchedSession as WatchedSession
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
