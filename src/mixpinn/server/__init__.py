"""A loaded bundle behind WebSocket and HTTP, for the page, for other programs, and for Python clients.

OpenIGTLink is the room `igtl`. Names are looked up when they are first used: this import alone brings no server.
"""
