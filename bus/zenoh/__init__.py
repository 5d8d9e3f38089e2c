"""The bus of a run of many processes: a router in the orchestrator, one client a process.

Only these files know Zenoh. Callbacks only hand over, because Zenoh prints and swallows what is raised in
one. Every wait has a deadline. Start a run only when `Router.wait_alive` has seen everybody: what is sent
before its subscriber is there is lost.
"""
