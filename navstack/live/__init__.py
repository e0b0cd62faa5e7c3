"""Watch a robot drive and take part: a session of a running simulation, and the page in the browser that shows it.

`session.py` and the modules beside it know nothing of the web; `server.py` connects them to pages. Needs aiohttp (extra `live`)
for the server only.
"""
